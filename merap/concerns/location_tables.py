"""Read what a combination has at its locations, as expressions over the location variables.

In a resolved expression the number of the location is called `@`, its row and column `@row` and `@col`;
with a prime they are those of the successor. No name of a user has an @.

Axes: P locations, Q modes, B steps.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from merap.concerns.processes import DeclaredProcess, moved
from merap.concerns.space import Attribute, Space
from merap.mdp.model import Bools, Ints
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.program.expressions import (
    TRUE,
    ZERO,
    Column,
    Expression,
    Lookup,
    Operation,
    Table,
    Variable,
    all_of,
    any_of,
    negation,
    number,
    parts,
    substitute,
    with_parts,
)

if TYPE_CHECKING:
    from merap.concerns.combination import DeclaredCombination

HERE, ROW, COL = "@", "@row", "@col"
THERE = f"{HERE}'"
# The step changes the location.
MOVES = Operation("!=", (Variable(THERE, 0), Variable(HERE, 0)))
# Coordinates move by one of so many distances, or else each move has its target.
MAX_SHIFTS = 8


class LocationTables:
    """The tables of a combination, each made once."""

    def __init__(self, combination: DeclaredCombination) -> None:
        self._combination = combination
        self._space = combination.space
        self._passable = combination.passable
        self._tables: dict[tuple[str, bytes], Table] = {}
        self._successors: dict[int, dict[str, Expression]] = {}
        self._here, there = self._index(""), self._index("'")
        here: dict[str, Expression] = {HERE: self._here, THERE: there}
        if self._space.shape is not None:
            here |= {name: Variable(name.removeprefix(HERE), 0) for name in (ROW, COL, f"{ROW}'", f"{COL}'")}
        for attribute in combination.environment.attributes:
            table = Table(attribute.name, attribute.column)
            here |= {
                attribute.name: Lookup(table, self._here),
                f"{attribute.name}'": Lookup(table, there),
            }
        self._meanings = here

    def _index(self, prime: str) -> Expression:
        if not self._space.located:
            return ZERO
        names = [Variable(f"{name}{prime}", 0) for name in self._space.variable_names]
        if self._space.shape is None:
            return names[0]
        columns = number(self._space.shape[1])
        return Operation("+", (Operation("*", (columns, names[0])), names[1]))

    def read(self, expression: Expression) -> Expression:
        """Return an expression over attributes as one over the location; primed: that of the successor."""
        if expression == MOVES:
            return moved(self._space.variable_names)
        if isinstance(expression, Variable):
            return self._meanings.get(expression.name, expression)
        return with_parts(expression, tuple(map(self.read, parts(expression))))

    def read_process(self, process: DeclaredProcess) -> DeclaredProcess:
        """Return a process whose changes read attributes as one that reads the location."""
        return process.mapped(self.read)

    def intended(self, expression: Expression, move: int | None) -> Expression:
        """Return a probability over attributes here and, primed, where a move leads; the mode stays.

        A move whose door is closed leads nowhere else.
        """
        known: dict[str, Expression] = {**self._meanings, f"{MODE_VARIABLE}'": Variable(MODE_VARIABLE, 0)}
        for attribute in self._combination.environment.attributes:
            known[f"{attribute.name}'"] = self._meanings[attribute.name]
            if move is not None:
                name = f"{attribute.name}_{self._space.moves[move]}"
                column = attribute.column[self._targets(move)]
                known[f"{attribute.name}'"] = self._through(
                    move, Lookup(self._table(name, column), self._here), self._meanings[attribute.name]
                )
        return substitute(expression, known)

    def open(self, move: int) -> Expression:
        """Return where a move is possible."""
        return all_of([self._open(move, self._passable[:, move]), *self._doors(move)])

    def _doors(self, move: int) -> list[Expression]:
        """Return conditions under which no closed door is in the way of a move."""
        conditions: list[Expression] = []
        for door in self._space.doors:
            in_the_way = door.edges[:, move] & self._passable[:, move]
            if in_the_way.any():
                conditions.append(any_of([negation(self._within(in_the_way)), Variable(door.name, 0)]))
        return conditions

    def _through(self, move: int, there: Expression, here: Expression) -> Expression:
        """Return what holds where a move leads, or here if a closed door is in its way."""
        doors = self._doors(move)
        return Operation("?:", (all_of(doors), there, here)) if doors else there

    def successor(self, move: int) -> Mapping[str, Expression]:
        """Return what a move makes of the location variables; those that it never changes are left out."""
        if move not in self._successors:
            after = self._space.valuations[self._targets(move)]
            columns = zip(self._space.variable_names, self._space.valuations.T, after.T, strict=True)
            self._successors[move] = {
                name: self._through(move, self._moved(move, name, old, new), Variable(name, 0))
                for name, old, new in columns
                if not np.array_equal(old, new)
            }
        return self._successors[move]

    def successors(self) -> dict[str, Expression]:
        """Return names for what was asked of `successor`."""
        return {
            f"{name}_{self._space.moves[move]}": value
            for move, values in self._successors.items()
            for name, value in values.items()
        }

    def _moved(self, move: int, name: str, old: Ints, new: Ints) -> Expression:
        here, label = Variable(name, 0), self._space.moves[move]
        distances = np.unique(new - old)
        steps = distances[distances != 0].tolist()
        if len(steps) == 1:
            distance = number(abs(steps[0]))
            there = Operation("+" if steps[0] > 0 else "-", (here, distance))
            return Operation("?:", (self._open(move, new != old), there, here))
        if len(distances) <= MAX_SHIFTS:
            table = self._table(f"{name}_step_{label}", Column.of(new - old), label)
            return Operation("+", (here, Lookup(table, self._here)))
        return Lookup(self._table(f"{name}_{label}", Column.of(new), label), self._here)

    def _open(self, move: int, mask: Bools) -> Expression:
        label = self._space.moves[move]
        return Lookup(self._table(f"open_{label}", Column.of(mask), label), self._here)

    def _targets(self, move: int) -> Ints:
        """int64 [P], where a move leads; a blocked one stays."""
        here = np.arange(self._space.num_locations)
        return np.where(self._passable[:, move], self._space.target[:, move], here)

    def _table(self, name: str, column: Column, step: str = "") -> Table:
        """Return a table; those of one name and content are one."""
        key = name, column.codes.tobytes()
        return self._tables.setdefault(key, Table(name, column, step))

    def _within(self, mask: Bools) -> Expression:
        """Return whether the location is in a mask (bool [P])."""
        return Lookup(self._table("", Column.of(mask)), self._here)


def is_mode(mode: int, name: str = MODE_VARIABLE) -> Expression:
    """Return the condition of one mode."""
    return Operation("=", (Variable(name, 0), number(mode)))


def mode_in(modes: Collection[int], count: int, name: str = MODE_VARIABLE) -> Expression:
    """Return membership in a set of modes, of which there are so many in all."""
    return TRUE if len(set(modes)) == count else any_of(is_mode(mode, name) for mode in sorted(modes))


def step_scope(space: Space, attributes: Iterable[Attribute], here: Ints, there: Ints) -> dict[str, Column]:
    """Return the columns that resolved expressions read of the locations in B steps.

    Args:
        space: the locations.
        attributes: of the locations.
        here: int64 [B].
        there: int64 [B], the successors' locations.
    """
    columns: dict[str, Column] = {}
    for prime, places in (("", here), ("'", there)):
        columns[f"{HERE}{prime}"] = Column.of(places)
        if space.shape is not None:
            row, column = np.divmod(places, space.shape[1])
            columns |= {f"{ROW}{prime}": Column.of(row), f"{COL}{prime}": Column.of(column)}
        columns |= {f"{attribute.name}{prime}": attribute.column[places] for attribute in attributes}
    return columns
