"""Verdicts: what an engine says of a combination's properties."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from merap.checker.building import BuiltModel, build_combination
from merap.checker.obstruction import obstruction
from merap.checker.properties import REACH, properties
from merap.concerns.combination import Combination
from merap.errors import InputError


@dataclass(frozen=True)
class Verdict:
    """One property of one combination.

    Attributes:
        combination: its name.
        name: of the property.
        property: its text.
        engine: which answered.
        value: expected over the initial distribution; None for a property with a bound.
        lower: sound lower bound of the value.
        upper: sound upper bound of the value.
        holds: None where the property asks for a value; `reach` holds if the value is positive.
        status: `unsupported` where the engine can't answer this kind of property.
        reason: for one that does not hold, what is known of why.
    """

    combination: str
    name: str
    property: str
    engine: str
    value: float | None
    lower: float | None
    upper: float | None
    holds: bool | None
    status: Literal["ok", "unsupported"]
    reason: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def verify(combinations: Iterable[Combination], only: str | None = None) -> Iterator[Verdict]:
    """Render, build and check combinations with Storm.

    Args:
        combinations: which.
        only: the name of one property; all by default.

    Raises:
        InputError: no property has that name, or one can't be parsed.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    for combination in combinations:
        wanted = properties(combination)
        if only is not None and only not in wanted:
            raise InputError(f"no property is called {only!r}; there are {', '.join(wanted)}")
        built = build_combination(combination)
        for name, text in wanted.items():
            if only in (None, name):
                yield _verdict(combination, built, name, text)


def _verdict(combination: Combination, built: BuiltModel, name: str, text: str) -> Verdict:
    answer = built.storm.check(text, built.mdp.initial)
    holds = answer.holds
    if name == REACH and answer.value is not None:
        holds = answer.value > 0
    reason = obstruction(combination) if holds is False else None
    return Verdict(
        combination=combination.name,
        name=name,
        property=text,
        engine="storm",
        value=answer.value,
        lower=answer.lower,
        upper=answer.upper,
        holds=holds,
        status="ok",
        reason=reason,
    )
