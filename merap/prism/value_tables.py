"""Tabulate an expression over the values that it reads, and bound it.

The location variables count as one: their joint values are written as boxes and runs, so that there may be
many. Of the other variables at most 4,096 joint values are listed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import prod

import numpy as np

from merap.errors import InputError
from merap.mdp.model import Ints
from merap.prism.location_tree import location_tree
from merap.program.expressions import (
    Column,
    Constant,
    Expression,
    Lookup,
    Operation,
    Value,
    Variable,
    tabulate,
    variables,
)
from merap.program.form import StateVariable

MAX_TABLE = 4096
MAX_CELLS = 10_000_000
COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
LOGICAL = frozenset({"=>", "<=>", "|", "&", "!"})


@dataclass(frozen=True)
class Domains:
    """The variables of a program.

    Attributes:
        variables: by name.
        location: those that hold the location together: row and column, or one number.
    """

    variables: Mapping[str, StateVariable]
    location: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> StateVariable:
        return self.variables[name]

    def is_truth(self, expression: Expression) -> bool:
        """Tell whether the value is true or false, not a number."""
        match expression:
            case Constant(value):
                return isinstance(value, bool)
            case Variable(name):
                return self.variables[name].kind == "bool"
            case Lookup(table, _):
                return table.kind == "bool"
            case Operation("?:", arguments):
                return self.is_truth(arguments[1])
            case Operation(symbol, _):
                return symbol in COMPARISONS | LOGICAL


def table_of(expression: Expression, domains: Domains) -> Expression:
    """Return the same as a tree of `?:` over the values of the variables it reads, with constants as leaves.

    Where the value is undefined any will do, as no reachable state may have these values.

    Raises:
        InputError: they have too many joint values.
    """
    axes, codes, values = _tabulated(expression, domains)
    known = list(dict.fromkeys(value for value in values if value is not None))
    if not known:
        return Constant(False if domains.is_truth(expression) else Fraction(0))
    place = {value: number for number, value in enumerate(known)}
    numbers = np.array([-1 if value is None else place[value] for value in values])[codes]
    leaves = [Constant(value) for value in known]
    return _tree(axes, _filled(numbers), leaves, domains)


def least_of(expression: Expression, domains: Domains) -> Fraction:
    """Return the least value of a number over the values that it reads, where it is defined; 0 if nowhere.

    Raises:
        InputError: they have too many joint values.
    """
    _, codes, values = _tabulated(expression, domains)
    occurring = (values[code] for code in np.unique(codes).tolist())
    return min((Fraction(value) for value in occurring if value is not None), default=Fraction(0))


def _tabulated(expression: Expression, domains: Domains) -> tuple[list[str], Ints, Sequence[Value | None]]:
    """Return the names of axes, the location's last; int64 [values of each], which value; the values."""
    names = sorted({variable.name for variable in variables(expression)})
    others = [name for name in names if name not in domains.location]
    axes = others if len(others) == len(names) else [*others, *domains.location]
    sizes = [domains[name].size for name in axes]
    listed, cells = prod(sizes[: len(others)]), prod(sizes)
    if listed > MAX_TABLE or cells > MAX_CELLS:
        raise InputError(
            f"an expression over {', '.join(axes)} has {cells} cases, at most {MAX_TABLE} can be listed for "
            f"each location, and {MAX_CELLS} in all; let it read fewer values, or compare whole numbers"
        )
    scope = {
        name: Column(
            domains[name].levels,
            np.arange(size).reshape([-1 if at == place else 1 for at in range(len(axes))]),
        )
        for place, (name, size) in enumerate(zip(axes, sizes, strict=True))
    }
    values, codes = tabulate(expression, scope)
    return axes, np.broadcast_to(codes, sizes), values


def _filled(numbers: Ints) -> Ints:
    """Put the number before it, or else the first, in place of each that is -1, so that runs get long."""
    flat = numbers.ravel()
    known = flat >= 0
    last = np.maximum.accumulate(np.where(known, np.arange(flat.size), -1))
    return flat[np.where(last < 0, np.argmax(known), last)].reshape(numbers.shape)


def _tree(axes: Sequence[str], numbers: Ints, leaves: Sequence[Constant], domains: Domains) -> Expression:
    first = int(numbers.flat[0])
    if np.all(numbers == first):
        return leaves[first]
    if axes[0] in domains.location:
        lows = [domains[name].low for name in axes]
        used, inverse = np.unique(numbers, return_inverse=True)
        window = inverse.reshape(numbers.shape if len(axes) == 2 else (1, -1))
        return location_tree(axes, lows, window, [leaves[number] for number in used.tolist()])
    rest = numbers.reshape(len(numbers), -1)
    starts = [0, *(np.flatnonzero(np.any(rest[1:] != rest[:-1], axis=1)) + 1).tolist()]
    trees = [_tree(axes[1:], numbers[start], leaves, domains) for start in starts]
    values = domains[axes[0]].levels.values
    return _split(Variable(axes[0], 0), [values[start] for start in starts], trees)


def _split(variable: Variable, starts: list[Value], trees: list[Expression]) -> Expression:
    """Balanced: the tree of the run in which a variable's value lies."""
    if len(trees) == 1:
        return trees[0]
    if isinstance(starts[0], bool):
        return _chosen(variable, trees[1], trees[0])
    middle = len(trees) // 2
    before = _split(variable, starts[:middle], trees[:middle])
    after = _split(variable, starts[middle:], trees[middle:])
    return _chosen(Operation("<", (variable, Constant(starts[middle]))), before, after)


def _chosen(condition: Expression, taken: Expression, other: Expression) -> Expression:
    """Return `condition ? taken : other`, or what is the same."""
    if (taken, other) == (Constant(True), Constant(False)):
        return condition
    if (taken, other) == (Constant(False), Constant(True)):
        return Operation("!", (condition,))
    return Operation("?:", (condition, taken, other))
