"""Verdicts: what an engine says of a combination's properties."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, Literal

from merap.checker.building import BuiltModel, build_combination
from merap.checker.obstruction import obstruction
from merap.checker.properties import REACH, properties
from merap.checker.storm import Answer
from merap.checker.storm_messages import UnsupportedPropertyError
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
        value: expected over the initial distribution, also of a property with a bound; None if
            there is none.
        lower: sound lower bound of the value.
        upper: sound upper bound of the value.
        holds: None where the property asks for a value; `reach` holds if the value is positive.
        status: `unsupported` where the engine can't answer this kind of property.
        reason: why it does not hold, or is not supported.
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
        """For JSON, which has no infinity: `inf` is a string."""
        return {
            name: str(value) if isinstance(value, float) and not isfinite(value) else value
            for name, value in asdict(self).items()
        }


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
    status: Literal["ok", "unsupported"] = "ok"
    try:
        answer = built.storm.check(text, built.mdp.initial)
        holds = _holds(name, answer)
        reason = _reason(combination, answer) if holds is False else None
    except UnsupportedPropertyError as error:
        answer = Answer(None, None, None, None)
        holds, reason, status = None, str(error), "unsupported"
    return Verdict(
        combination=combination.name,
        name=name,
        property=text,
        engine="storm",
        value=answer.value,
        lower=answer.lower,
        upper=answer.upper,
        holds=holds,
        status=status,
        reason=reason,
    )


def _holds(name: str, answer: Answer) -> bool | None:
    if name == REACH and answer.holds is None and answer.value is not None:
        return answer.value > 0
    return answer.holds


def _reason(combination: Combination, answer: Answer) -> str:
    """What cuts the goal off in space; else by how much the value misses the bound."""
    cut = obstruction(combination)
    if cut is not None:
        return cut
    open_way = "the goal can be reached in space"
    if answer.value is None:
        return open_way
    if answer.value == 0:
        return f"{open_way}; the modes, or where the task ends, prevent it"
    return f"{open_way}; the value is {answer.value:.6g}"
