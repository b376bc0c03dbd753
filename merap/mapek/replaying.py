"""Replay a recorded run: feed the loop with the same observations, and compare its decisions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Any

from merap.concerns.document import Document
from merap.concerns.validation import validate
from merap.errors import InputError
from merap.knowledge.base import KnowledgeBase
from merap.knowledge.replay import DecisionDifference, decision_differences
from merap.knowledge.rows import DecisionRow, RunRow
from merap.learning.threads import one_thread
from merap.mapek.components import make_components
from merap.mapek.loop import Loop
from merap.mapek.run_store import read_history
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_schema import ScenarioSpec
from merap.runs.run_folder import RunFolder

ACTION = "action"
# a fallback is decided by the clock: it is repeated, not derived
DERIVED = ("replan", "update", "settled", "extended", ACTION)


def check_decisions(run: RunFolder, knowledge: KnowledgeBase, number: int) -> tuple[DecisionDifference, ...]:
    """Return where the loop, fed with the recorded observations, acts or decides otherwise than recorded.

    Args:
        run: the training run that the loop ran with.
        knowledge: the base that has the record.
        number: number of the run of the loop there.

    Raises:
        InputError: the recorded run is not one of a loop, or was made with another case.
    """
    recorded = [*knowledge.decisions(number), *_actions(knowledge, number)]
    return decision_differences(recorded, _derived(run, knowledge, number), DERIVED)


def _actions(knowledge: KnowledgeBase, number: int) -> Iterator[DecisionRow]:
    for row in knowledge.observations(number):
        yield DecisionRow(row.episode, row.step, ACTION, (str(row.action),))


def _derived(run: RunFolder, knowledge: KnowledgeBase, number: int) -> Iterator[DecisionRow]:
    row = knowledge.run(number)
    if row.digest != run.case.digest:
        raise InputError(f"run {number} was made with another case than {run.path}", source=knowledge.place)
    scenario, manager = _begun_with(row, knowledge.place)
    history = read_history(knowledge, number)
    components = make_components(run, scenario, manager, history)
    components.runner.patient = True
    with one_thread(), closing(components):
        loop = Loop(components)
        for _ in history.episodes:
            log = loop.episode()
            for decision in log.decisions:
                yield DecisionRow(log.episode, decision.step, decision.kind, decision.reasons)
            for step, execution in enumerate(log.executions):
                yield DecisionRow(log.episode, step, ACTION, (str(execution.action),))


def _begun_with(row: RunRow, place: str) -> tuple[Scenario, str]:
    """Return the scenario and the manager of a run, from its settings."""
    try:
        data, manager = _as_read(row.settings["scenario"]), str(row.settings["manager"])
    except (KeyError, TypeError) as error:
        raise InputError(f"run {row.id} is not one of a loop: it has no scenario", source=place) from error
    document = Document(f"{place}, run {row.id}", b"", None, data)
    return Scenario(validate(document, ScenarioSpec), document), manager


def _as_read(value: Any) -> Any:
    """Return JSON as the reader of scenario files has it: sequences are tuples."""
    if isinstance(value, Mapping):
        return {key: _as_read(entry) for key, entry in value.items()}
    return tuple(map(_as_read, value)) if isinstance(value, list) else value
