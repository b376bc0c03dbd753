"""Number the states of a program: a state's code has a digit for each variable.

Axes: N states, V variables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from merap.errors import ModelError
from merap.mdp.model import Ints
from merap.program.expressions import Column, Columns, Combinations
from merap.program.form import StateVariable

MAX_CODES = 2**62
# The values of a variable that has not more than these are listed once; else those that occur are.
LISTED, LISTED_PER_STATE = 4096, 4


@dataclass(frozen=True, eq=False)
class Encoding:
    """Codes of all valuations of some variables; the last variable counts fastest.

    Attributes:
        variables: V of them.

    Raises:
        ModelError: there are more valuations than 64 bits can number.
    """

    variables: tuple[StateVariable, ...]

    def __post_init__(self) -> None:
        if self.size > MAX_CODES:
            raise ModelError(
                f"the variables have {float(self.size):.3g} joint values, at most 2^62 are allowed"
            )

    @cached_property
    def size(self) -> int:
        """The number of valuations."""
        return prod(variable.size for variable in self.variables)

    @cached_property
    def strides(self) -> Mapping[str, int]:
        """How far two states are apart that differ by 1 in a variable."""
        sizes = [variable.size for variable in self.variables]
        return {variable.name: prod(sizes[place + 1 :]) for place, variable in enumerate(self.variables)}

    @cached_property
    def by_name(self) -> Mapping[str, StateVariable]:
        """The variables by name."""
        return {variable.name: variable for variable in self.variables}

    def digits(self, codes: Ints, name: str) -> Ints:
        """int64 [N], how far a variable is above its least value."""
        found: Ints = codes // self.strides[name] % self.by_name[name].size
        return found

    def valuations(self, codes: Ints) -> Ints:
        """int64 [N, V]."""
        columns = [self.digits(codes, one.name) + one.low for one in self.variables]
        return np.stack(columns, axis=1) if columns else np.zeros((len(codes), 0), dtype=np.int64)

    def codes(self, valuations: Ints) -> Ints:
        """int64 [N], of valuations [N, V] within the variables' ranges."""
        codes = np.zeros(len(valuations), dtype=np.int64)
        for column, variable in zip(valuations.T, self.variables, strict=True):
            codes += (column - variable.low) * self.strides[variable.name]
        return codes

    def describe(self, code: int) -> str:
        """Describe a state, as `(row=3, lit=true, stage=loaded)`."""
        return f"({', '.join(self._terms(code))})"

    def _terms(self, code: int) -> Iterator[str]:
        for variable in self.variables:
            digit = code // self.strides[variable.name] % variable.size
            yield f"{variable.name}={variable.text(variable.low + digit)}"


class States(Columns):
    """Some states as columns of values, one for each variable, made when it is first read.

    Args:
        encoding: of the program's variables.
        codes: int64 [N].
    """

    def __init__(self, encoding: Encoding, codes: Ints) -> None:
        self.encoding = encoding
        self.codes = codes
        self._columns: dict[str, Column] = {}
        self._digits: dict[str, Ints] = {}

    def __getitem__(self, name: str) -> Column:
        if name not in self._columns:
            variable = self.encoding.by_name[name]
            digits = self.digits(name)
            listed = variable.size <= max(LISTED, LISTED_PER_STATE * len(digits))
            self._columns[name] = (
                Column(variable.levels, digits) if listed else Column.of(digits + variable.low)
            )
        return self._columns[name]

    def digits(self, name: str) -> Ints:
        """int64 [N], how far a variable is above its least value."""
        if name not in self._digits:
            self._digits[name] = self.encoding.digits(self.codes, name)
        return self._digits[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.encoding.by_name)

    def __len__(self) -> int:
        return len(self.encoding.variables)

    def some(self, rows: Ints) -> States:
        """Return those in some rows, rising; columns that are there are not made anew."""
        if len(rows) == len(self.codes):
            return self
        chosen = States(self.encoding, self.codes[rows])
        chosen._columns = {name: column[rows] for name, column in self._columns.items()}
        chosen._digits = {name: digits[rows] for name, digits in self._digits.items()}
        return chosen


class StepColumns(Columns):
    """States before a step and, primed, after it.

    Args:
        before: where the steps begin.
        after: primed or unprimed name -> value after the step; what is not there keeps its value.
    """

    def __init__(self, before: States, after: Mapping[str, Column]) -> None:
        self._before, self._after = before, after

    def __getitem__(self, name: str) -> Column:
        if not name.endswith("'"):
            return self._before[name]
        plain = name.removesuffix("'")
        return self._after[plain] if plain in self._after else self._before[plain]

    def combinations(self, names: tuple[str, ...]) -> Combinations:
        """Return the combinations of the columns with some names."""
        if any(name.endswith("'") for name in names):
            return super().combinations(names)
        return self._before.combinations(names)

    def __iter__(self) -> Iterator[str]:
        for name in self._before:
            yield from (name, f"{name}'")

    def __len__(self) -> int:
        return 2 * len(self._before)
