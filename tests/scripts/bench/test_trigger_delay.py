"""The trigger's figures at a smaller scale than `python -m scripts.bench trigger`, slip and noise stated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest

from merap.concerns.combination import Combination
from merap.families.loading import load_case
from merap.trigger.settings import WindowSettings
from scripts.bench.trigger_batch import count_alarms, first_alarm, trace
from scripts.bench.trigger_bound import nats_per_episode, ratio
from scripts.bench.trigger_delay import (
    KINDS,
    Change,
    World,
    change_delays,
    changes,
    unchanged,
    watch,
    window_delays,
)
from scripts.bench.trigger_streams import Known, effect, known
from tests.support.hand_made import cells, grid_combination

WORLD = World(slip=0.1, noise=0.5)
GOAL = (4, 4)


@cache
def before() -> Known:
    return known(grid_combination(goal=GOAL), WORLD.slip)


def change_to(combination: Combination) -> Change:
    real = WORLD.model(combination)
    return Change("", before(), before().model, real, effect(before(), real))


def nats(change: Change) -> float:
    return nats_per_episode(change.before, ratio(change.before.model, change.real, WORLD.noise))


def first_cell() -> tuple[int, int]:
    """The way leads through it with certainty."""
    return {2: (1, 0), 4: (0, 1)}[int(before().policy[0, 1].argmax())]


def test_100_000_steps_without_a_change() -> None:
    """The bound gives 1 % for an alarm in a stream, so 10^-4 for two; this seed has none in three."""
    generator = np.random.default_rng(0)
    for _ in range(3):
        readings = unchanged(before(), before().model, WORLD, 100_000, generator)
        assert len(readings) == 100_000
        assert count_alarms(WORLD.settings, readings) <= 1


def test_the_bound_on_false_alarms_holds_and_is_not_vacuous() -> None:
    """Within n steps the evidence passes c with a probability of at most n / c.

    1000 streams; 4 standard deviations of the bound itself are added, which luck passes once in 30,000.
    """
    readings = unchanged(before(), before().model, WORLD, 200_000, np.random.default_rng(1))
    streams = [readings.part(slice(begin, begin + 200)) for begin in range(0, 200_000, 200)]
    highest = np.exp([trace(WORLD.settings, one).evidence.max() for one in streams])
    for bound in (0.5, 0.2, 0.1):
        passed = (highest >= 200 / bound).mean()
        assert passed <= bound + 4 * np.sqrt(bound * (1 - bound) / 1000)
    assert (highest >= 200 / 0.5).any()


@pytest.mark.parametrize("what", ["blocked", "no entry", "another goal"])
def test_a_costly_change_is_seen_within_three_episodes(what: str) -> None:
    """20 seeds each; all of them see it here, 95 percent are demanded."""
    combination = {
        "blocked": grid_combination(blocked=cells(first_cell()), goal=GOAL),
        "no entry": grid_combination(no_entry=cells(first_cell()), goal=GOAL),
        "another goal": grid_combination(goal=(4, 5)),
    }[what]
    change = change_to(combination)
    assert change.kind == "costly"
    delays = change_delays(watch(change, WORLD, 20, 10, np.random.default_rng(2)), WORLD.settings)
    assert (delays <= 3).mean() >= 0.95
    assert np.nanmin(delays) >= 1


def test_a_block_far_down_a_long_way_is_seen_by_what_is_learned_of_its_place() -> None:
    """11 steps are as expected before the first that fails; 18 are all. Here 20 of 20 seeds see it."""
    long = known(grid_combination(goal=(8, 5)), WORLD.slip)
    here = 1
    for t in range(12):
        row = long.model.transitions[[long.model.choice_table[here, long.policy[t, here].argmax()]]]
        here = int(row.indices[row.data.argmax()])
    blocked = tuple(long.model.valuations[here].tolist())
    real = WORLD.model(grid_combination(blocked=cells(blocked[:2]), goal=(8, 5)))
    change = Change("", long, long.model, real, effect(long, real))
    assert change.kind == "costly"
    watched = watch(change, WORLD, 20, 20, np.random.default_rng(10))
    without = WORLD.settings.model_copy(update={"local": 1e-12})
    assert (change_delays(watched, WORLD.settings) <= 3).mean() >= 0.95
    assert (change_delays(watched, without) <= 3).mean() < 0.5


@pytest.mark.parametrize(("tails", "seen"), [("gaussian", True), ("symmetric", False)])
def test_a_goal_that_pays_less_shows_once_an_episode(
    tails: Literal["gaussian", "symmetric"], seen: bool
) -> None:
    """2 instead of 10 is 16 deviations of the noise; where any noise is possible it is half a nat.

    With 13.8 nats to gather that takes some 20 episodes more.
    """
    model = before().model
    assert model.branch_reward is not None
    less = replace(
        model,
        branch_reward=np.where(model.branch_reward == 10, 2.0, model.branch_reward),
        choice_reward=np.where(model.choice_reward == 10, 2.0, model.choice_reward),
    )
    change = Change("", before(), model, less, effect(before(), less))
    assert change.kind == "costly"
    world = replace(WORLD, tails=tails)
    delays = change_delays(watch(change, world, 20, 20, np.random.default_rng(7)), world.settings)
    assert ((delays <= 3).mean() >= 0.95) == seen
    assert (delays.min() > 10) != seen


def test_a_change_off_the_path_is_no_reason() -> None:
    change = change_to(grid_combination(blocked=cells((8, 8), (7, 0)), goal=GOAL))
    assert change.kind == "off the path"
    watched = watch(change, WORLD, 5, 300, np.random.default_rng(3))
    assert np.all(np.isinf(change_delays(watched, WORLD.settings)))
    assert nats(change) == pytest.approx(0, abs=1e-9)


def test_a_change_for_the_better_is_no_reason() -> None:
    """The robot slips less than was stated: that is visible, but nothing is lost by it."""
    world = replace(WORLD, real_slip=0.0)
    real = world.model(grid_combination(goal=GOAL))
    change = Change("", before(), before().model, real, effect(before(), real))
    assert change.kind == "harmless"
    watched = watch(change, WORLD, 5, 300, np.random.default_rng(4))
    assert nats(change) > 0.5
    assert np.all(np.isinf(change_delays(watched, WORLD.settings)))


def test_an_alarm_before_the_change_is_no_detection() -> None:
    change = change_to(grid_combination(blocked=cells(first_cell()), goal=GOAL))
    watched = watch(change, WORLD, 3, 10, np.random.default_rng(5))
    eager = WORLD.settings.model_copy(update={"deviations": 1e-9, "tolerated_loss": 0.0})
    assert np.all(np.isnan(change_delays(watched, eager, log_threshold=0.01)))


def test_delays_are_counted_in_episodes() -> None:
    """A blocked way costs every step: the first episode after the change earns -9 or so."""
    change = change_to(grid_combination(blocked=cells(first_cell()), goal=GOAL))
    watched = watch(change, WORLD, 5, 10, np.random.default_rng(6))
    assert window_delays(watched, WindowSettings(threshold=-3.0)).tolist() == [1.0] * 5
    assert np.all(np.isinf(window_delays(watched, WindowSettings(threshold=-100.0))))
    for readings, begin in watched.streams:
        alarm = first_alarm(trace(WORLD.settings, readings), WORLD.settings)
        assert alarm is not None
        assert alarm >= begin


def test_drawn_changes_are_of_all_sorts_and_repeat_with_the_seed() -> None:
    case = load_case("models/running-example")
    first, second = (list(changes(case, 12, WORLD, np.random.default_rng(7))) for _ in range(2))
    assert [one.name for one in first] == [one.name for one in second]
    assert len({one.kind for one in first} & set(KINDS)) >= 3
    # in turn environment, capability, objective, all
    parts = [[name.split(".") for name in one.name.split(" -> ")] for one in first[:4]]
    differ = [[a != b for a, b in zip(*pair, strict=True)] for pair in parts]
    assert differ == [[True, False, False], [False, True, False], [False, False, True], [True] * 3]


def test_what_is_lost_is_missing() -> None:
    world = replace(WORLD, lost=0.25)
    readings = unchanged(before(), before().model, world, 4000, np.random.default_rng(8))
    assert len(readings) == 4000
    whole = unchanged(before(), before().model, WORLD, 4000, np.random.default_rng(8))
    assert world.seen(whole, np.random.default_rng(9)).reward.size == pytest.approx(3000, abs=120)
