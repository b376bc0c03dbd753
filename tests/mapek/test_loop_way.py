"""The way of an observation to an action: the loop hands it to each component once, in one order."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from merap.mapek import loop
from merap.mapek.components import make_components
from merap.mapek.messages import Analysis, Execution, Monitored, Plan
from merap.systems.interface import Observation
from merap.systems.sightings import Sighting, Transition
from tests.support.loop_runs import scenario
from tests.support.paths import MODELS
from tests.support.trained_runs import trained

MESSAGES = (Observation, Execution, Transition, Sighting, Monitored, Analysis, Plan)
WAY = ["monitor", "analyzer", "learning_shield", "learner", "planner", "executor"]


def carries(value: object) -> bool:
    return isinstance(value, MESSAGES) or (isinstance(value, tuple) and any(map(carries, value)))


@contextmanager
def handed_on() -> Iterator[list[str]]:
    """The modules to which the loop hands a message, in order."""
    found: list[str] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        if event != "call" or frame.f_back is None or frame.f_back.f_globals["__name__"] != loop.__name__:
            return
        folder, _, module = frame.f_globals["__name__"].rpartition(".")
        if folder.startswith("merap.") and module != "loop" and any(map(carries, frame.f_locals.values())):
            found.append(module)

    sys.setprofile(note)
    try:
        yield found
    finally:
        sys.setprofile(None)


def test_each_component_is_entered_once(tmp_path: Path) -> None:
    run = trained(tmp_path / "run", case=MODELS / "running-example")
    text = "scenario: way\nsystem: met\nepisodes: 1\nshield: {threshold: 0}\n"
    looping = loop.Loop(make_components(run, scenario(tmp_path, text), "merap"))
    with handed_on() as found:
        log = looping.episode()
    steps = len(log.executions) - 1
    assert steps > 1
    # the last observation leads to no action, and the episode is recorded
    assert found == [*WAY * steps, *WAY[: WAY.index("planner")], "records"]
