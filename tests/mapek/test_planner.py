from __future__ import annotations

import math
import threading

import numpy as np
import pytest

from merap.mapek.learner import Learner
from merap.mapek.messages import Analysis, Phase, Plan
from merap.mapek.planner import Late, Planner
from merap.mdp.model import Bools, Floats
from merap.systems.deadline import DeadlineRunner, Lateness
from merap.systems.sightings import Sighting
from tests.support.loop_examples import NUM_ACTIONS, Told, monitored, seen

EXPLORED, FALLBACK = 3, 2
ALL = np.ones(NUM_ACTIONS, dtype=np.bool_)
HERE = 7
DRAWS = 4000


class Slow(Told):
    """Decides when it is told to."""

    def __init__(self, signal: threading.Event) -> None:
        super().__init__(EXPLORED)
        self.signal = signal

    def act(self, allowed: Bools) -> int:
        self.signal.wait(60)
        return super().act(allowed)


def ready(strategy: Told) -> Learner:
    learning = Learner(lambda generator: strategy, np.random.default_rng(0))
    learning.learn_from(monitored(HERE, [Sighting(HERE, seen(0, 7), 0)]))
    return learning


def planner(
    table: Floats,
    *,
    runner: DeadlineRunner | None = None,
    strategy: Told | None = None,
    late: Late | None = None,
    fallback: int | None = FALLBACK,
) -> Planner:
    planning = Planner(
        ready(strategy or Told(EXPLORED)),
        fallback,
        runner or DeadlineRunner(None),
        np.random.default_rng(0),
        late or {},
    )
    planning.adopt(table)
    return planning


def analysis(phase: Phase, *where: tuple[int, float]) -> Analysis:
    whereabouts = np.zeros(82)
    for state, probability in where or ((HERE, 1.0),):
        whereabouts[state] = probability
    return Analysis(phase, whereabouts)


def table(**rows: list[float]) -> Floats:
    """float64 [82, 5]: action 0, but for the states `s<number>`."""
    policy = np.tile(np.eye(NUM_ACTIONS)[0], (82, 1))
    for name, shares in rows.items():
        policy[int(name[1:])] = shares
    return policy


def test_while_adapting_the_learner_acts() -> None:
    assert planner(table()).plan(monitored(HERE), analysis("adapting"), ALL) == Plan(EXPLORED, "exploration")


def test_while_executing_the_policy_is_carried_out() -> None:
    policy = table(s7=[0, 1, 0, 0, 0])
    assert planner(policy).plan(monitored(HERE), analysis("executing"), ALL) == Plan(1, "policy")


def test_a_policy_by_time_is_taken_at_its_step() -> None:
    by_time = np.stack([table(s7=[0, 1, 0, 0, 0]), table(s7=[0, 0, 1, 0, 0])])
    planning = planner(by_time)
    actions = [planning.plan(monitored(HERE, step=t), analysis("executing"), ALL).action for t in range(4)]
    assert actions == [1, 2, 2, 2]


def test_where_the_state_is_not_seen_the_policy_is_averaged() -> None:
    """0.25 for action 1 and 0.75 for action 4: 4 standard deviations, by luck once in 16,000."""
    planning = planner(table(s7=[0, 1, 0, 0, 0], s8=[0, 0, 0, 0, 1]))
    blind = monitored(None, seen_state=7)
    for phase in ("adapting", "executing"):
        plans = [planning.plan(blind, analysis(phase, (7, 0.25), (8, 0.75)), ALL) for _ in range(DRAWS)]
        assert {plan.source for plan in plans} == {"prediction"}
        ones = sum(plan.action == 1 for plan in plans)
        assert ones + sum(plan.action == 4 for plan in plans) == DRAWS
        assert abs(ones - 0.25 * DRAWS) <= 4 * math.sqrt(DRAWS * 0.25 * 0.75)


def test_only_what_is_allowed_is_planned() -> None:
    allowed = np.array([True, False, True, False, False])
    planning = planner(table(s7=[0, 0.9, 0.1, 0, 0]))
    assert planning.plan(monitored(HERE), analysis("executing"), allowed).action == 2
    nothing_left = planner(table(s7=[0, 1, 0, 0, 0]))
    assert nothing_left.plan(monitored(HERE), analysis("executing"), allowed).action in {0, 2}


@pytest.mark.parametrize(("fallback", "expected"), [(FALLBACK, 2), (1, 0), (None, 0)])
def test_after_a_fault_the_fallback_is_taken_and_it_is_always_allowed(
    fallback: int | None, expected: int
) -> None:
    allowed = np.array([True, False, True, False, False])
    faulty = monitored(HERE, problems=("lost", "garbled"))
    plan = planner(table(), fallback=fallback).plan(faulty, analysis("adapting"), allowed)
    assert plan == Plan(expected, "fallback", "garbled")


def begun_but_late(planning: Planner) -> Plan:
    """Asked until the learner, on however busy a machine, has begun to think in time."""
    while (plan := planning.plan(monitored(HERE), analysis("adapting"), ALL)).reason == Lateness.BUSY:
        pass
    return plan


def test_a_plan_that_is_late_is_replaced() -> None:
    signal = threading.Event()
    with DeadlineRunner(0.01) as runner:
        planning = planner(table(), runner=runner, strategy=Slow(signal))
        assert begun_but_late(planning) == Plan(FALLBACK, "fallback", "the plan was late")
        signal.set()
        runner.finish()


def test_a_learner_that_is_busy_is_not_asked() -> None:
    signal, strategy = threading.Event(), Told(EXPLORED)
    with DeadlineRunner(0.01) as runner:
        planning = planner(table(), runner=runner, strategy=strategy)
        runner.later(lambda: signal.wait(60))
        plan = planning.plan(monitored(HERE), analysis("adapting"), ALL)
        signal.set()
        runner.finish()
    assert plan == Plan(FALLBACK, "fallback", "the learner was busy with earlier steps")
    assert "act" not in strategy.calls


@pytest.mark.parametrize("how", Lateness)
def test_a_plan_that_was_late_is_late_again_when_it_is_repeated(how: Lateness) -> None:
    """The learner is asked again where it was asked then."""
    strategy = Told(EXPLORED)
    planning = planner(table(), strategy=strategy, late={(0, 3): how})
    plans = [planning.plan(monitored(HERE, step=t), analysis("adapting"), ALL) for t in (2, 3, 4)]
    assert [plan.source for plan in plans] == ["exploration", "fallback", "exploration"]
    assert plans[1].reason == how
    assert strategy.calls.count("act") == (3 if how is Lateness.LATE else 2)


RIGHT_AT_7 = [0.0, 0, 0, 0, 1]
BLIND = monitored(None, seen_state=HERE)


def test_a_policy_is_carried_out_once_it_is_made() -> None:
    """Until then a plan is late, though the learner has nothing to say to it."""
    signal, made = threading.Event(), table(s7=RIGHT_AT_7)
    with DeadlineRunner(0.01) as runner:
        planning = planner(table(), runner=runner)
        future = runner.later(lambda: signal.wait(60))
        planning.expect(lambda: made if future.result() else table())
        assert planning.plan(BLIND, analysis("adapting"), ALL).reason == Lateness.BUSY
        assert planning.table is not made
        signal.set()
        runner.patient = True
        assert planning.plan(BLIND, analysis("adapting"), ALL) == Plan(4, "prediction")
        assert planning.table is made


@pytest.mark.parametrize(("how", "adopted"), [(Lateness.BUSY, False), (Lateness.LATE, True)])
def test_a_policy_is_adopted_in_the_step_in_which_it_was_when_it_is_repeated(
    how: Lateness, adopted: bool
) -> None:
    planning, made = planner(table(), late={(0, 0): how}), table(s7=RIGHT_AT_7)
    planning.expect(lambda: made)
    assert planning.plan(monitored(HERE), analysis("adapting"), ALL).reason == how
    assert (planning.table is made) == adopted


def test_a_policy_that_was_expected_gives_way_to_a_later_one() -> None:
    planning, later = planner(table()), table(s7=RIGHT_AT_7)
    planning.expect(table)
    planning.adopt(later)
    planning.catch_up()
    assert planning.table is later
