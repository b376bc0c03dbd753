"""Persist a run of the loop episode by episode, and read it back to resume it.

An episode is committed as a whole, after its end: a run that was killed amid an episode begins that
episode anew, and has all episodes before it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from safetensors.numpy import save

from merap.errors import InputError
from merap.knowledge.base import KnowledgeBase
from merap.knowledge.event_log import EventLog, JsonLines, event_row
from merap.knowledge.rows import DecisionRow, EventRow, Level, ObservationRow, PolicyKind
from merap.mapek.messages import Execution
from merap.mapek.records import EpisodeLog, EpisodeRow
from merap.mapek.scores import LoopReport
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from merap.mdp.umb import write_umb
from merap.runs.checkpoint import policy_bytes
from merap.systems.deadline import Lateness

EPISODE = "episode"
FALLBACK = "fallback"
# Kinds of decisions that are logged, with the component and the level of the line.
_LOGGED: Mapping[str, tuple[str, Level]] = {
    "replan": ("analyzer", "info"),
    "settled": ("analyzer", "info"),
    "extended": ("learner", "info"),
    FALLBACK: ("planner", "warning"),
}


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """An episode of an earlier process.

    Attributes:
        row: its row of the report.
        seconds: wall time.
        observations: after the reset and after every step.
        late: step -> the way in which its plan was late.
        taken: step -> the action that the system took in place of the requested one.
    """

    row: EpisodeRow
    seconds: float
    observations: tuple[ObservationRow, ...] = field(repr=False)
    late: Mapping[int, Lateness]
    taken: Mapping[int, int]


@dataclass(frozen=True, eq=False)
class RunHistory:
    """The committed episodes of a run.

    Attributes:
        episodes: in order.
        system: state of the simulated system after them; None: it has none that can be recorded.
    """

    episodes: tuple[RecordedEpisode, ...] = ()
    system: Mapping[str, Any] | None = None


NO_HISTORY = RunHistory()


@dataclass(frozen=True, eq=False)
class _StoredPolicy:
    """A policy as it is stored, with the model that it was made for (`umb`), if there is one."""

    kind: PolicyKind
    updates: int
    tensors: bytes = field(repr=False)
    name: str
    umb: bytes | None = field(repr=False)


class RunStore:
    """Stores a run in a knowledge base.

    Args:
        knowledge: open.
        run: number of the run there.
        lines: file to which the log is written too.
    """

    def __init__(self, knowledge: KnowledgeBase, run: int, lines: JsonLines | None = None) -> None:
        self._knowledge = knowledge
        self._run = run
        self._lines = lines
        self._log = EventLog(lines, knowledge, run)

    def commit(self, log: EpisodeLog, row: EpisodeRow, system: Mapping[str, Any] | None) -> None:
        """Store an episode and the state of the system after it, if it has one, or nothing of it.

        Everything that takes long is done before the lock on the knowledge base is held, and the log is
        written after it, so that each line is about a stored episode.
        """
        knowledge, run = self._knowledge, self._run
        observations, decisions, events = observation_rows(log), _decisions(log, row), _events(log, row)
        learned, state = _learned(log), json.dumps(system).encode()
        with knowledge.transaction():
            knowledge.record_observations(run, observations)
            for decision in decisions:
                knowledge.record_decision(run, decision)
            for made in learned:
                model = None if made.umb is None else knowledge.record_model(run, made.name, made.umb)
                knowledge.record_policy(run, made.kind, made.updates, made.tensors, model)
            for event in events:
                knowledge.record_event(run, event)
            knowledge.record_checkpoint(run, log.episode + 1, state)
        if self._lines is not None:
            for event in events:
                self._lines.write(event)

    def end(self, report: LoopReport) -> None:
        """Store the report, if there is none; a run that was ended by a fault can be resumed instead."""
        if report.ended_by is not None:
            self._log.event("executor", "error", str(report.ended_by))
        elif self._knowledge.run(self._run).finished is None:
            self._knowledge.finish_run(self._run, report.as_dict())


def _decisions(log: EpisodeLog, row: EpisodeRow) -> list[DecisionRow]:
    """Return the decisions of an episode, and its row of the report."""
    made = [DecisionRow(log.episode, one.step, one.kind, one.reasons) for one in log.decisions]
    content = {"row": asdict(row), "seconds": log.seconds, "taken": _taken(log)}
    return [*made, DecisionRow(log.episode, row.steps, EPISODE, (), content)]


def _learned(log: EpisodeLog) -> list[_StoredPolicy]:
    """Return the policies that an episode has led to."""
    made = []
    if log.policy is not None:
        umb = None if log.model is None else umb_bytes(log.model)
        tensors = save({"policy": np.ascontiguousarray(log.policy.table)})
        made.append(_StoredPolicy("adapted", log.policy.update, tensors, f"analysis_{log.episode}", umb))
    if log.extension is not None:
        added = log.extension
        tensors = policy_bytes(added.meta)
        made.append(_StoredPolicy("meta", added.updates, tensors, added.name, umb_bytes(added.model)))
    return made


def _events(log: EpisodeLog, row: EpisodeRow) -> list[EventRow]:
    """Return the lines of the log: problems, decisions, and the end of the episode."""

    def event(component: str, level: Level, message: str, step: int) -> EventRow:
        return event_row(component, level, message, episode=log.episode, step=step)

    told = [event("executor", "warning", problem.message, problem.step) for problem in log.problems]
    for decision in log.decisions:
        if decision.kind in _LOGGED:
            message = f"{decision.kind}: {'; '.join(decision.reasons)}"
            told.append(event(*_LOGGED[decision.kind], message, decision.step))
    if row.faults:
        faults = ", ".join(f"{count} {kind}" for kind, count in row.faults.items())
        told.append(event("executor", "warning", f"faults of the system: {faults}", row.steps))
    of = "" if row.possible is None else f" of {row.possible:.4g}"
    told.append(event("monitor", "info", f"episode {row.episode} returned {row.earned:.4g}{of}", row.steps))
    return told


def umb_bytes(model: TabularMDP) -> bytes:
    """Return the UMB archive of a model."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.umb"
        write_umb(restrict_to_reachable(model), path)
        return path.read_bytes()


def observation_rows(log: EpisodeLog) -> list[ObservationRow]:
    """Return the observations of an episode; where there was none, a row says so."""
    return [_observation_row(log.episode, step, execution) for step, execution in enumerate(log.executions)]


def _observation_row(episode: int, step: int, execution: Execution) -> ObservationRow:
    if execution.observation is None:
        return ObservationRow(episode, step, None, execution.action, 0.0, 1.0, False)
    return ObservationRow.of(episode, step, execution.action, execution.observation)


def _taken(log: EpisodeLog) -> dict[str, int]:
    """Return step -> the action that was taken in place of another one; keys as JSON has them."""
    return {
        str(step): execution.observation.taken
        for step, execution in enumerate(log.executions)
        if execution.observation is not None and execution.observation.taken is not None
    }


def read_history(knowledge: KnowledgeBase, run: int) -> RunHistory:
    """Return the committed episodes of a run.

    Raises:
        InputError: it does not fit together, or two processes have gone on with it.
    """
    checkpoint = knowledge.latest_checkpoint(run)
    if checkpoint is None:
        return NO_HISTORY
    decisions = list(knowledge.decisions(run))
    try:
        system = json.loads(checkpoint.state)
        ended = [decision.data for decision in decisions if decision.kind == EPISODE]
        rows = [EpisodeRow(**content["row"]) for content in ended]
        seconds = [float(content["seconds"]) for content in ended]
        taken = [{int(step): int(action) for step, action in content["taken"].items()} for content in ended]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"run {run} of the knowledge base is not one of a loop: {error}") from error
    numbers = [row.episode for row in rows]
    if numbers != list(range(checkpoint.episode)):
        kept = ", ".join(map(str, numbers))
        raise InputError(
            f"run {run} can't be gone on with: it has the episodes {kept}, expected each up to "
            f"{checkpoint.episode - 1} once; another process goes on with it, or has done so",
            source=knowledge.place,
        )
    observations: list[list[ObservationRow]] = [[] for _ in rows]
    for row in knowledge.observations(run):
        observations[row.episode].append(row)
    late: list[dict[int, Lateness]] = [{} for _ in rows]
    for one in decisions:
        # a fallback after a fault follows from what was observed
        if one.kind == FALLBACK and one.reasons[0] in set(Lateness):
            late[one.episode][one.step] = Lateness(one.reasons[0])
    episodes = map(RecordedEpisode, rows, seconds, map(tuple, observations), late, taken)
    return RunHistory(tuple(episodes), system)
