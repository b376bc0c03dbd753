"""Give the words that say where the system is their meaning: `at`, `row`, `col` and `moved`.

Axes: P locations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from merap.concerns.location_tables import COL, HERE, MOVES, ROW, THERE
from merap.concerns.parameters import find_location
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    IN,
    Column,
    Constant,
    Expression,
    Kind,
    Lookup,
    Operation,
    Table,
    Variable,
    any_of,
    number,
)
from merap.program.names import suggestion

AT, MOVED = "at", "moved"
_COORDINATES = {"row": ROW, "col": COL}
WORDS = (*_COORDINATES, MOVED)


@dataclass(frozen=True, eq=False, repr=False)
class LocationWords(ShortRepr):
    """The words that an expression may use.

    Attributes:
        space: the locations.
        here: whether the location before the step may be read.
        there: whether that of the successor may be.
        parameters: names of those that hold locations, for messages.
    """

    space: Space
    here: bool
    there: bool
    parameters: tuple[str, ...] = ()

    @cached_property
    def kinds(self) -> dict[str, Kind]:
        """The types of what may stand for the location in a resolved expression."""
        names = [HERE] if self.space.located else []
        if self.space.shape is not None:
            names += [ROW, COL]
        primes = (["", "'"] if self.there else [""]) if self.here else []
        return {f"{name}{prime}": "number" for prime in primes for name in names}

    def meaning(self, said: Variable) -> Expression | None:
        """Return what a name means; None if it is no word.

        Raises:
            InputError: the word has no meaning in this space, or can't be read here.
        """
        if said.name == MOVED:
            self._require(said.name, THERE, said.column)
            return MOVES
        name = said.name.removesuffix("'")
        if name not in _COORDINATES:
            return None
        if self.space.located and self.space.shape is None:
            raise InputError(f"{said.name!r} at column {said.column}: rows and columns belong to a grid")
        resolved = _COORDINATES[name] + said.name[len(name) :]
        self._require(said.name, resolved, said.column)
        return Variable(resolved, said.column)

    def _require(self, said: str, needed: str, column: int) -> None:
        if needed in self.kinds:
            return
        if not self.space.located:
            raise InputError(f"{said!r}{_column(column)} speaks of locations, and the case has no space")
        why = "where a step leads is not known" if self.here else "the location is not known"
        raise InputError(f"{said!r}{_column(column)} can't be read here: {why}")

    def membership(self, said: Operation, held: Callable[[Variable], Variable | None]) -> Expression:
        """Return what `at(..)` or `at'(..)` means: being at one of some locations.

        Args:
            said: its operands are names and cells.
            held: the resolved name of a parameter that holds locations; None: there is none of that name.

        Raises:
            InputError: a location is unknown, or the successor's can't be read here.
        """
        names = [place for place in said.arguments if isinstance(place, Variable)]
        text = f"{said.operator}({', '.join(map(_text, said.arguments))})"
        needed = HERE + said.operator[len(AT) :]
        self._require(text, needed, names[0].column if names else 1)
        index = Variable(needed, 0)
        terms: list[Expression] = []
        mask = np.zeros(self.space.num_locations, dtype=np.bool_)
        for place in said.arguments:
            if isinstance(place, Operation):
                mask[find_location(_cell(place), self.space)] = True
            elif isinstance(place, Variable):
                parameter = None if place.name in self.space.location_index else held(place)
                if parameter is None:
                    mask[self._named(place)] = True
                else:
                    terms.append(Operation(IN, (index, parameter)))
        if mask.any():
            terms.insert(0, Lookup(Table("", Column.of(mask), meaning=text), index))
        return any_of(terms)

    def _named(self, place: Variable) -> int:
        if place.name not in self.space.location_index:
            near = suggestion(place.name, (*self.parameters, *self.space.locations))
            raise InputError(f"unknown location {place.name!r}{_column(place.column)}{near}")
        return self.space.location_index[place.name]


def _column(column: int) -> str:
    """Return where a word stands in an expression; 0: it stands in none."""
    return f" at column {column}" if column else ""


def _text(place: Expression) -> str:
    if isinstance(place, Operation):
        row, column = _cell(place)
        return f"[{row}, {column}]"
    return place.name if isinstance(place, Variable) else ""


def cell(row: int, col: int) -> Expression:
    """Return a cell as `at(..)` has it."""
    return Operation("cell", (number(row), number(col)))


def _cell(place: Operation) -> tuple[int, int]:
    given = [part.value for part in place.arguments if isinstance(part, Constant)]
    if any(value.denominator != 1 for value in given):
        raise InputError(f"expected a cell [row, col] of whole numbers, got {list(map(float, given))}")
    return int(given[0]), int(given[1])
