"""Verify combinations: have their properties checked, and explain false verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple

from merap.checker.attempts import Attempt, Status, attempt, for_json
from merap.checker.exchange import Answer, ModelText
from merap.checker.model_text import model_text
from merap.checker.obstruction import goal_locations, obstruction
from merap.checker.process import CheckingProcess, OverTimeError
from merap.checker.properties import HOLDS_IF_POSITIVE, TIMEOUT, properties
from merap.concerns.arguments import as_text
from merap.concerns.combination import Combination, DeclaredCombination
from merap.concerns.lookup import as_combination
from merap.errors import InputError


@dataclass(frozen=True)
class Verdict:
    """One property of one combination.

    Attributes:
        combination: the combination's name.
        name: the property's name.
        property: the text of the property.
        engine: the one that answered.
        value: expected over the initial distribution, also of a property with a bound; None if
            there is none.
        lower: sound lower bound of the value.
        upper: sound upper bound of the value.
        holds: None where the property asks for a value; `reach` holds if the value is positive.
        status: `unsupported` where the engine can't answer this kind of property, `timeout` where
            it has no answer in time.
        reason: why it does not hold, is not supported or has no answer.
    """

    combination: str
    name: str
    property: str
    engine: str
    value: float | None
    lower: float | None
    upper: float | None
    holds: bool | None
    status: Status
    reason: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON, which has no infinity: `inf` is a string."""
        return {name: for_json(value) for name, value in asdict(self).items()}


def verify(
    combinations: Iterable[Combination],
    only: str | None = None,
    *,
    timeout: float = TIMEOUT,
) -> Iterator[Verdict]:
    """Render, build and check combinations with Storm, in a process of its own.

    Args:
        combinations: in this order.
        only: the name of one property, for the combinations that have it; all by default.
        timeout: seconds for building a model, and for each property.

    Raises:
        InputError: no property has that name, or one can't be parsed; no such timeout.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    with CheckingProcess(timeout) as process:
        tasks = _tasks(combinations, only)
        task = next(tasks, None)
        while task is not None:
            process.begin(task.model)
            following = next(tasks, None)  # rendered while Storm builds
            yield from _verdicts(process, task)
            task = following


class _Task(NamedTuple):
    combination: Combination
    properties: Mapping[str, str]
    model: ModelText


def _tasks(combinations: Iterable[Combination], only: str | None) -> Iterator[_Task]:
    """Render every combination that has a property to check."""
    only = None if only is None else as_text(only, "only")
    names: dict[str, None] = {}
    for combination in map(as_combination, combinations):
        wanted = properties(combination)
        names |= dict.fromkeys(wanted)
        if only is not None:
            wanted = {name: text for name, text in wanted.items() if name == only}
        if wanted:
            yield _Task(combination, wanted, model_text(combination))
    if only is not None and only not in names:
        raise InputError(f"no property is called {only!r}; there are {', '.join(names)}")


def _verdicts(process: CheckingProcess, task: _Task) -> Iterator[Verdict]:
    combination, wanted = task.combination, task.properties
    try:
        process.finish()
    except OverTimeError as error:
        late = Attempt(Answer(), "timeout", str(error))
        yield from (_verdict(combination, name, text, late) for name, text in wanted.items())
        return
    for name, text in wanted.items():
        yield _verdict(combination, name, text, attempt(partial(process.check, text)))


def _verdict(combination: Combination, name: str, text: str, found: Attempt) -> Verdict:
    answer = found.answer
    holds = answer.holds
    if name in HOLDS_IF_POSITIVE and holds is None and answer.value is not None:
        holds = answer.value > 0
    return Verdict(
        combination=combination.name,
        name=name,
        property=text,
        engine="storm",
        value=answer.value,
        lower=answer.lower,
        upper=answer.upper,
        holds=holds,
        status=found.status,
        reason=_reason(combination, answer) if holds is False else found.reason,
    )


def _reason(combination: Combination, answer: Answer) -> str | None:
    """Explain a false verdict: the obstacles that cut the goal off in space, else the value."""
    value = None if answer.value is None else f"the value is {answer.value:.6g}"
    if not isinstance(combination, DeclaredCombination) or not goal_locations(combination).any():
        return value
    cut = obstruction(combination)
    if cut is not None:
        return cut
    open_way = "the goal can be reached in space"
    if answer.value == 0:
        return f"{open_way}; what actions require, the modes, or where the task ends prevent it"
    return open_way if value is None else f"{open_way}; {value}"
