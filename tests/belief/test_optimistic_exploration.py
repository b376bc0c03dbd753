from __future__ import annotations

import numpy as np
import pytest

from merap.belief.model import DomainModel
from merap.belief.optimistic_exploration import OptimisticOutcome, optimistic_plans
from merap.belief.planning import plan

HORIZON = 6
START, FIRST, SECOND, GOAL = range(4)
DARING, LIKELY, SURE = range(3)
NO_TIES = np.zeros((3, 4))


def ways(daring: float, likely: float, bonus: float) -> DomainModel:
    """A goal three sure steps away, or one step by a way that may be closed.

    Args:
        daring: probability that the first short way is open.
        likely: that the second is.
        bonus: what the first pays more than the second.
    """
    target = np.tile(np.arange(4)[:, np.newaxis], (3, 1, 2))  # slot 0 stays
    target[:, START, 1] = GOAL
    target[SURE, [START, FIRST, SECOND], 1] = FIRST, SECOND, GOAL
    prob = np.zeros((3, 4, 2))
    prob[..., 0] = 1.0
    prob[[DARING, LIKELY], START, 1] = daring, likely
    prob[SURE, [START, FIRST, SECOND], 1] = 1.0
    prob[..., 0] = 1 - prob[..., 1]
    reward = np.full((3, 4, 2), -1.0)
    reward[DARING, START, 1] += bonus
    reward[:, GOAL] = 10.0
    continuation = np.ones((3, 4, 2))
    continuation[:, GOAL] = 0.0
    return DomainModel(target, prob, np.ones((3, 4), dtype=np.bool_), reward, continuation)


def found(daring: float, likely: float, bonus: float = 0.0) -> list[OptimisticOutcome]:
    mean, optimistic = ways(daring, likely, bonus), ways(1.0, 1.0, bonus)
    best = plan(mean, HORIZON)
    # the sure way: three steps at -1, and 10 at the goal
    assert best.values[0, START] == pytest.approx(7)
    return [outcome for outcome, _ in optimistic_plans(mean, best, optimistic, START, NO_TIES)]


@pytest.mark.parametrize(("daring", "likely"), [(0.01, 0.3), (0.3, 0.01)])
def test_of_ways_with_as_much_to_gain_the_likelier_is_tried(daring: float, likely: float) -> None:
    # By hand: two steps fewer. Where it is closed, a step at -1 is lost, and five are left for the sure way.
    (first,) = found(daring, likely)
    assert (first.chance, first.gain, first.price) == pytest.approx((0.3, 2, 0.7))


def test_a_likelier_plan_with_less_to_gain_comes_next() -> None:
    first, second = found(daring=0.01, likely=0.3, bonus=2)
    assert (first.chance, first.gain, first.price) == pytest.approx((0.01, 4, 0.99))
    assert (second.chance, second.gain, second.price) == pytest.approx((0.3, 2, 0.7))
    # over 20 episodes the first is worth 0.8 and costs 0.99
    assert not first.pays(20)
    assert second.pays(20)


def test_without_doubt_there_is_nothing_to_try() -> None:
    mean = ways(1.0, 1.0, 0.0)
    assert not list(optimistic_plans(mean, plan(mean, HORIZON), mean, START, NO_TIES))
