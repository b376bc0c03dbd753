from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from merap.concerns.case_study import load_case
from merap.errors import InputError
from merap.online.belief.space import HypothesisSpace, hypothesis_space
from merap.online.loop.messages import Analysis, Monitored, Sighting, Transition
from merap.online.loop.protection import Protection
from merap.online.shield.shielded_strategy import ShieldSettings
from merap.online.systems import Observation
from tests.loop_examples import monitored
from tests.trained_runs import grid_case

HORIZON = 40


@pytest.fixture(scope="module")
def space() -> HypothesisSpace:
    """The running example: it is dark, and so unsafe, at B and in the store."""
    return hypothesis_space(load_case(Path(__file__).parents[1] / "models" / "running-example"))


def state(space: HypothesisSpace, location: str) -> int:
    """The robot idles there."""
    return space.space.location_index[location] * space.num_modes


def enabled(space: HypothesisSpace) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """In a terminal mode everything but the automaton's own action."""
    return np.array([name != "measure" for name in space.case.actions])


def seen(space: HypothesisSpace, location: str) -> Observation:
    return Observation(space.valuations[state(space, location)], enabled(space), -1.0, 1.0, False)


def here(space: HypothesisSpace, location: str, news: Sighting | Transition) -> Monitored:
    return replace(monitored(state(space, location), [news]), enabled=enabled(space))


def where(space: HypothesisSpace, **probability: float) -> Analysis:
    whereabouts = np.zeros(space.num_states + 1)
    for location, mass in probability.items():
        whereabouts[state(space, location)] = mass
    return Analysis("executing", whereabouts)


def at(space: HypothesisSpace, location: str) -> Protection:
    protection = Protection(space, HORIZON, ShieldSettings(0.0))
    protection.begin()
    sighting = Sighting(state(space, location), seen(space, location))
    protection.observe(here(space, location, sighting))
    return protection


def allowed(space: HypothesisSpace, protection: Protection, **probability: float) -> set[str]:
    message = replace(monitored(None), enabled=enabled(space))
    mask = protection.allowed(message, where(space, **probability))
    return {name for name, free in zip(space.case.actions, mask, strict=True) if free}


def test_the_dark_is_not_entered(space: HypothesisSpace) -> None:
    found = allowed(space, at(space, "hall_nw"), hall_nw=1.0)
    assert "east" not in found
    assert {"stop", "south", "west", "start_scan"} <= found


def test_all_places_where_the_system_may_be_count(space: HypothesisSpace) -> None:
    """East is dark from hall_nw and west from hall_n."""
    protection = at(space, "hall_nw")
    assert not {"east", "west"} & allowed(space, protection, hall_nw=0.5, hall_n=0.5)
    assert "west" in allowed(space, protection, hall_nw=0.995, hall_n=0.005)


def test_steps_are_followed_and_counted(space: HypothesisSpace) -> None:
    protection = at(space, "S")
    east = space.case.actions.index("east")
    step = Transition(0, state(space, "S"), east, state(space, "lobby"), seen(space, "lobby"))
    assert "east" in allowed(space, protection, S=1.0)
    protection.observe(here(space, "lobby", step))
    assert "east" in allowed(space, protection, lobby=1.0)
    counts = protection.as_dict()
    assert (counts["episodes"], counts["steps"], counts["worst_risk"]) == (1, 2, 0.0)


def test_after_a_change_it_begins_anew_and_the_counts_go_on(space: HypothesisSpace) -> None:
    protection = at(space, "hall_nw")
    allowed(space, protection, hall_nw=1.0)
    protection.forget()
    protection.begin()
    protection.observe(here(space, "S", Sighting(state(space, "S"), seen(space, "S"))))
    allowed(space, protection, S=1.0)
    counts = protection.as_dict()
    assert (counts["episodes"], counts["steps"]) == (2, 2)


def test_a_policy_is_carried_out_within_the_mask(space: HypothesisSpace) -> None:
    protection = at(space, "hall_nw")
    east = space.case.actions.index("east")
    table = np.tile(np.eye(len(space.case.actions))[east], (space.num_states + 1, 1))
    masked = protection.masked(table)
    assert masked[state(space, "hall_nw"), east] == 0
    assert masked[state(space, "hall_nw")].sum() == pytest.approx(1)
    assert masked[state(space, "lobby"), east] == 1
    assert not protection.mask[state(space, "hall_nw"), east]
    assert protection.mask[state(space, "lobby"), east]


def test_where_nothing_is_unsafe_there_is_nothing_to_protect_from() -> None:
    with pytest.raises(InputError, match="unsafe"):
        Protection(hypothesis_space(grid_case()), 18, ShieldSettings(0.0))
