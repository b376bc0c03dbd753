"""Generated supports as numbers: the r-th choice of a parameter, without listing all.

A choice of k of n members has the rank it has in lexicographic order (Knuth, The Art of
Computer Programming 4A, section 7.2.1.3); a support ranks its parameters like digits, the
first one slowest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from merap.concerns.parameters import ParameterValue, Values
from merap.errors import InputError
from merap.mdp.model import Ints
from merap.mdp.short_repr import ShortRepr

MAX_LABEL_LENGTH = 80


@dataclass(frozen=True, eq=False, repr=False)
class Choice(ShortRepr):
    """The values that one parameter ranges over.

    Attributes:
        parameter: its name.
        members: canonical values of a scalar, or of the members of a set.
        labels: their names, distinct.
        sizes: how many members are chosen; None for a scalar.
        separator: between labels in the name of a choice.
    """

    parameter: str
    members: tuple[Any, ...]
    labels: tuple[str, ...]
    sizes: range | None
    separator: str

    @cached_property
    def count(self) -> int:
        """The number of values."""
        if self.sizes is None:
            return len(self.members)
        return sum(math.comb(len(self.members), size) for size in self.sizes)

    @cached_property
    def _position(self) -> dict[Any, int]:
        return {member: position for position, member in enumerate(self.members)}

    @cached_property
    def _numbered(self) -> bool:
        """Whether names give the rank, because labels would be too long for a file name."""
        longest = max(map(len, self.labels), default=0) + len(self.separator)
        return longest * (self.sizes[-1] if self.sizes else 1) > MAX_LABEL_LENGTH

    def positions(self, rank: int) -> tuple[int, ...]:
        """Positions of the chosen members, rising."""
        if self.sizes is None:
            return (rank,)
        for size in self.sizes:
            block = math.comb(len(self.members), size)
            if rank < block:
                return unrank(len(self.members), size, rank)
            rank -= block
        raise IndexError(rank)

    def value(self, rank: int) -> ParameterValue:
        """The canonical value with that rank."""
        return self._value(self.positions(rank))

    def _value(self, positions: tuple[int, ...]) -> ParameterValue:
        if self.sizes is None:
            return self.members[positions[0]]  # type: ignore[no-any-return]
        return tuple(sorted(self.members[position] for position in positions))

    def values(self) -> Iterator[ParameterValue]:
        """Yield all values by rank."""
        everything = range(len(self.members))
        for size in self.sizes if self.sizes is not None else (1,):
            for positions in itertools.combinations(everything, size):
                yield self._value(positions)

    def rank(self, value: Any) -> int | None:
        """The rank of a canonical value; None if the parameter does not range over it."""
        chosen = value if self.sizes is not None else (value,)
        if any(member not in self._position for member in chosen):
            return None
        return self._rank(sorted(self._position[member] for member in chosen))

    def _rank(self, positions: Sequence[int]) -> int | None:
        if self.sizes is None:
            return positions[0]
        if len(positions) not in self.sizes:
            return None
        smaller = range(self.sizes.start, len(positions))
        return sum(math.comb(len(self.members), size) for size in smaller) + rank_of(
            len(self.members), positions
        )

    def name(self, rank: int) -> str:
        """`blocked_r1c2_r3c2`."""
        if self._numbered:
            return f"{self.parameter}_number{rank}"
        order = sorted(self.positions(rank), key=lambda position: _order(self.members[position]))
        return f"{self.parameter}_" + self.separator.join(self.labels[position] for position in order)

    def rank_of_name(self, name: str) -> int | None:
        """The rank of the value with that name; None if there is none."""
        text = name.removeprefix(f"{self.parameter}_")
        if text == name:
            return None
        if self._numbered:
            rank = int(text[6:]) if text.startswith("number") and text[6:].isdecimal() else self.count
        else:
            known = {label: position for position, label in enumerate(self.labels)}
            labels = text.split(self.separator) if self.sizes is not None else [text]
            if any(label not in known for label in labels):
                return None
            found = self._rank(sorted(known[label] for label in labels))
            rank = self.count if found is None else found
        return rank if rank < self.count and self.name(rank) == name else None

    def first_with(self, member: Any) -> int | None:
        """A low rank whose value holds `member`: the lowest of the smallest size."""
        position = self._position.get(member)
        if position is None or self.sizes is None:
            return position
        others = [other for other in range(len(self.members)) if other != position]
        return self._rank(sorted([position, *others[: self.sizes.start - 1]]))


def _order(member: Any) -> Any:
    return member if isinstance(member, int | tuple) else 0


def unrank(total: int, size: int, rank: int) -> tuple[int, ...]:
    """The `size`-combination of range(total) with that lexicographic rank."""
    positions = []
    position = 0
    for remaining in range(size, 0, -1):
        while (block := math.comb(total - position - 1, remaining - 1)) <= rank:
            rank -= block
            position += 1
        positions.append(position)
        position += 1
    return tuple(positions)


def rank_of(total: int, positions: Sequence[int]) -> int:
    """The lexicographic rank of a rising combination of range(total)."""
    rank, previous = 0, -1
    for index, position in enumerate(positions):
        remaining = len(positions) - index - 1
        rank += sum(math.comb(total - skipped - 1, remaining) for skipped in range(previous + 1, position))
        previous = position
    return rank


@dataclass(frozen=True, eq=False, repr=False)
class Product(ShortRepr):
    """Every combination of the choices of several parameters, by rank."""

    choices: tuple[Choice, ...]
    separator: str

    @cached_property
    def count(self) -> int:
        """The number of combinations."""
        return math.prod(choice.count for choice in self.choices)

    def ranks(self, rank: int) -> tuple[int, ...]:
        """The rank of each parameter's choice."""
        digits = []
        for choice in reversed(self.choices):
            rank, digit = divmod(rank, choice.count)
            digits.append(digit)
        return tuple(reversed(digits))

    def rank(self, ranks: Sequence[int | None]) -> int | None:
        """The inverse; None if a part is."""
        total = 0
        for choice, digit in zip(self.choices, ranks, strict=True):
            if digit is None:
                return None
            total = total * choice.count + digit
        return total

    def values(self, rank: int) -> Values:
        """Parameter -> canonical value."""
        ranks = self.ranks(rank)
        return {choice.parameter: choice.value(r) for choice, r in zip(self.choices, ranks, strict=True)}

    def all_values(self) -> Iterator[Values]:
        """Yield all of them by rank."""
        names = [choice.parameter for choice in self.choices]
        for values in itertools.product(*(choice.values() for choice in self.choices)):
            yield dict(zip(names, values, strict=True))

    def rank_of_values(self, values: Values) -> int | None:
        """The rank of these values; None if they are not among them."""
        return self.rank([choice.rank(values[choice.parameter]) for choice in self.choices])

    def name(self, rank: int) -> str:
        """The names of the choices, joined."""
        ranks = self.ranks(rank)
        return self.separator.join(choice.name(r) for choice, r in zip(self.choices, ranks, strict=True))

    def rank_of_name(self, name: str) -> int | None:
        """The rank of the configuration with that name; None if there is none."""
        parts = name.split(self.separator)
        if len(parts) != len(self.choices):
            return None
        return self.rank(
            [choice.rank_of_name(part) for choice, part in zip(self.choices, parts, strict=True)]
        )

    def first_with(self, parameter: str, member: Any) -> int | None:
        """A rank whose value of `parameter` holds `member`; None if no value does."""
        digits = [
            choice.first_with(member) if choice.parameter == parameter else 0 for choice in self.choices
        ]
        return self.rank(digits)


def separators(labels: Sequence[str]) -> tuple[str, str]:
    """Return the separators of members and of parameters with which names can be read back.

    Raises:
        InputError: no separator is safe.
    """
    if not any("_" in label for label in labels):
        return "_", "__"
    for label in labels:
        if "__" in label or label.startswith("_") or label.endswith("_"):
            raise InputError(
                f"generated configurations can't be named after {label!r}: "
                "a name used there may not begin or end with _ or contain __"
            )
    return "__", "___"


def draw(total: int, count: int, generator: np.random.Generator) -> Iterator[Ints]:
    """Distinct ranks below `total` in random order, in blocks, without listing a large range.

    The blocks end when `total` is exhausted.
    """
    if total <= 100 * count or total <= 100_000:
        yield generator.permutation(total)
        return
    seen: set[int] = set()
    while len(seen) < total:
        fresh = dict.fromkeys(generator.integers(total, size=count).tolist())
        block = [rank for rank in fresh if rank not in seen]
        seen.update(block)
        yield np.array(block, dtype=np.int64)
