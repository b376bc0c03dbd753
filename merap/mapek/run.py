"""A run of the loop on a scenario: `merap run`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from os import PathLike
from typing import Any

from merap.concerns.arguments import as_instance, as_text
from merap.errors import InputError, warn_of
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.engine import url_of
from merap.knowledge.event_log import JsonLines
from merap.learning.threads import one_thread
from merap.mapek.components import Wrapper, make_components, unwrapped
from merap.mapek.connecting import connected
from merap.mapek.family_limits import followable
from merap.mapek.loop import Components, Loop
from merap.mapek.managers import MERAP
from merap.mapek.records import EpisodeLog, EpisodeRow
from merap.mapek.run_store import NO_HISTORY, RecordedEpisode, RunHistory, RunStore, read_history
from merap.mapek.scenario import Scenario, as_scenario
from merap.mapek.scores import LoopReport, reactions
from merap.runs.checkpoint import POLICY_FILE
from merap.runs.run_folder import RunFolder, as_run
from merap.systems.interface import SystemFault

OnEpisode = Callable[[EpisodeRow], None]
# Number of episodes in a row that could not even begin, after which a run ends.
GONE = 3


def run_loop(
    run: RunFolder | str | PathLike[str],
    scenario: Scenario | str | PathLike[str],
    *,
    manager: str = MERAP,
    knowledge: KnowledgeBase | str | PathLike[str] | None = None,
    lines: JsonLines | None = None,
    resume: bool = False,
    wrap: Wrapper = unwrapped,
    on_episode: OnEpisode = lambda row: None,
) -> LoopReport:
    """Control the system of a scenario.

    A system that is not simulated may be gone for a while: then the run ends early, and `resume` goes on.

    Args:
        run: a finished training run, or its folder.
        scenario: the system, and its changes; or the path of a scenario file.
        manager: one of `managers.MANAGERS`.
        knowledge: the base in which the run is recorded, open, or its URL or path; None: it is not recorded.
        lines: file to which the log of a recorded run is written too.
        resume: go on with the last run of this scenario and manager in the knowledge base; one that
            is finished is reported again.
        wrap: stands between the loop and the system, as `systems.retrying.RetryingSystem`, which is closed
            after the run.
        on_episode: called after each episode, those that were recorded before included.

    Raises:
        InputError: the scenario does not fit the case, a name is unknown, or there is no such run
            to go on with.
        SystemFault: the system can't be reached, before any episode.
    """
    run, manager = as_run(run), as_text(manager, "manager")
    scenario, notices = followable(as_scenario(scenario), run.case)
    warn_of(notices)
    if lines is not None:
        as_instance(lines, JsonLines, "lines")
    if isinstance(knowledge, str | PathLike):
        with open_knowledge(url_of(str(knowledge))) as opened:
            return run_loop(
                run,
                scenario,
                manager=manager,
                knowledge=opened,
                lines=lines,
                resume=resume,
                wrap=wrap,
                on_episode=on_episode,
            )
    if knowledge is not None:
        as_instance(knowledge, KnowledgeBase, "knowledge")
    number, history = None, NO_HISTORY
    if resume:
        if knowledge is None:
            raise InputError("there is no knowledge base to go on from")
        number = _last_run(run, scenario, manager, knowledge)
        history = read_history(knowledge, number)
    with connected(scenario, run.case, len(history.episodes)) as live:
        components = make_components(run, scenario, manager, history, wrap, live)
        store = None
        if knowledge is not None:
            number = _begun(run, scenario, manager, knowledge) if number is None else number
            store = RunStore(knowledge, number, lines)
        rows, seconds, ended_by = _rows(components, scenario.spec.episodes, history, store, on_episode)
    shielded = components.shield.report()
    report = LoopReport(
        scenario=scenario.spec.scenario,
        manager=manager,
        case=run.case.name,
        seed=scenario.spec.seed,
        rows=rows,
        reactions=reactions(rows, components.system.stages),
        shield=None if shielded is None else shielded.as_dict(),
        seconds=seconds,
        ended_by=ended_by,
    )
    if store is not None:
        store.end(report)
    return report


def _rows(
    components: Components,
    episodes: int,
    history: RunHistory,
    store: RunStore | None,
    on_episode: OnEpisode,
) -> tuple[tuple[EpisodeRow, ...], tuple[float, ...], SystemFault | None]:
    """Return all episodes, their seconds of wall time, and the fault that ended them."""
    rows, seconds = [], []
    try:
        with one_thread(), closing(components):
            for row, taken in _course(components, episodes, history, store):
                rows.append(row)
                seconds.append(taken)
                on_episode(row)
    except SystemFault as fault:
        return tuple(rows), tuple(seconds), fault
    return tuple(rows), tuple(seconds), None


def _named(scenario: Scenario, manager: str) -> tuple[str, dict[str, Any]]:
    """Return name and settings of a run in the knowledge base."""
    return f"{scenario.spec.scenario}.{manager}", {"scenario": scenario.settings(), "manager": manager}


def _begun(run: RunFolder, scenario: Scenario, manager: str, knowledge: KnowledgeBase) -> int:
    """Begin a new run in the knowledge base, with its first meta policy; return its number."""
    name, settings = _named(scenario, manager)
    with knowledge.transaction():
        number = knowledge.start_run(name, run.case.name, run.case.digest, settings)
        knowledge.record_policy(number, "meta", run.config.updates, (run.path / POLICY_FILE).read_bytes())
    return number


def _last_run(run: RunFolder, scenario: Scenario, manager: str, knowledge: KnowledgeBase) -> int:
    """Return the number of the last run of this scenario and manager.

    Raises:
        InputError: there is none, or it was begun with another case or other settings.
    """
    name, settings = _named(scenario, manager)
    found = [row for row in knowledge.runs() if row.name == name]
    if not found:
        raise InputError(f"there is no run {name!r} in the knowledge base to go on with")
    last = max(found, key=lambda row: row.id)
    if last.digest != run.case.digest or last.settings != settings:
        raise InputError(
            f"run {last.id} ({name}) was begun with another case or other settings; begin a new one"
        )
    return last.id


def _course(
    components: Components, episodes: int, history: RunHistory, store: RunStore | None
) -> Iterator[tuple[EpisodeRow, float]]:
    """Yield the row of the report and the seconds of wall time of each episode."""
    loop = Loop(components)
    components.runner.patient = True
    for recorded in history.episodes:
        _require_same(loop.episode(), recorded)
        yield recorded.row, recorded.seconds
    components.runner.patient = False
    if history.system is not None:
        components.system.restore(history.system)
    gone = 0
    for number in range(len(history.episodes), episodes):
        components.system.begin(number)
        row, log = _episode(components, loop)
        if store is not None:
            store.commit(log, row, components.system.snapshot())
        yield row, log.seconds
        begun = log.executions[0]
        gone = gone + 1 if begun.observation is None else 0
        if gone == GONE:
            message = f"none of the last {gone} episodes could begin, and no other is tried: {begun.fault}"
            raise SystemFault("gone", message, repeatable=False)


def _require_same(log: EpisodeLog, recorded: RecordedEpisode) -> None:
    """Refuse to go on if the same observations don't lead to the same actions.

    Raises:
        InputError: they don't.
    """
    taken = [execution.action for execution in log.executions]
    before = [row.action for row in recorded.observations]
    if taken != before:
        step = next(
            (index for index, pair in enumerate(zip(taken, before, strict=False)) if pair[0] != pair[1]),
            min(len(taken), len(before)),
        )
        raise InputError(
            f"episode {log.episode} went differently when it was recorded, from step {step} on: "
            "the run folder or the program is not the same any more"
        )


def _episode(components: Components, loop: Loop) -> tuple[EpisodeRow, EpisodeLog]:
    """Run one episode; return its row of the report and its log."""
    system = components.system
    before, stage = loop.table, system.stage
    log = loop.episode()
    truth, tally = system.truth, system.tally
    entered = None if truth is None or system.stage == stage else truth.value(before, components.index)
    return (
        EpisodeRow(
            episode=log.episode,
            stage=system.stage,
            phase=log.phase,
            steps=tally.steps,
            earned=tally.earned,
            discounted=tally.discounted,
            optimum=None if truth is None else truth.reachable.optimum,
            discounted_optimum=None if truth is None else truth.discounted_optimum,
            expected=None if truth is None else truth.value(loop.table, components.index),
            entered=entered,
            unsafe=tally.unsafe,
            completed=tally.completed,
            replans=log.count("replan"),
            updates=log.count("update"),
            fallbacks=log.count("fallback"),
            problems=len(log.problems),
            safe_optimum=None if truth is None or truth.safe_optimum is None else truth.safe_optimum.value,
            faults=tally.faults,
        ),
        log,
    )
