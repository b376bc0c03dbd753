from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from merap.concerns.case_study import load_case
from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.online.belief.space import hypothesis_space
from merap.online.belief.strategy import BeliefStrategy
from merap.online.managed.guarded_strategy import GuardedStrategy
from merap.online.running import episode
from merap.online.systems import Observation, SimulatedSystem

ACTIONS = ("stop", "go")
STOP, GO = range(2)
SEEN = Observation(np.zeros(1, np.int64), np.ones(2, np.bool_), 0.0, 1.0, False)
ALL = np.ones(2, dtype=np.bool_)


class Slow:
    """Decides for `go`, once the gate is open."""

    episodes_per_update = 3

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.calls: list[object] = []

    def begin(self, observation: Observation) -> None:
        self.calls.append("begin")

    def act(self, allowed: Bools) -> int:
        assert self.gate.wait(60)
        self.calls.append("act")
        return GO

    def observe(self, action: int, observation: Observation) -> None:
        self.calls.append(ACTIONS[action])

    def update(self) -> None:
        self.calls.append("update")

    def policy(self) -> Floats:
        return np.full((1, 2), 0.5)

    def explain(self) -> tuple[str, ...]:
        return ("why not",)


def guarded(strategy: Slow, deadline: float = 0.05) -> GuardedStrategy:
    return GuardedStrategy(strategy, ACTIONS, deadline=deadline, fallback="stop")


def test_a_decision_in_time_is_the_strategy_s() -> None:
    slow = Slow()
    slow.gate.set()
    guard = guarded(slow, deadline=60)
    guard.begin(SEEN)
    assert guard.act(ALL) == GO
    guard.observe(GO, SEEN)
    guard.update()
    assert guard.policy().tolist() == [[0.5, 0.5]]
    assert guard.explain() == ("why not",)
    assert guard.episodes_per_update == 3
    assert guard.times_late == 0
    assert slow.calls == ["begin", "act", "go", "update"]


def test_a_late_decision_is_replaced_and_what_was_done_is_observed_later() -> None:
    slow = Slow()
    guard = guarded(slow)
    guard.begin(SEEN)
    assert guard.act(ALL) == STOP
    guard.observe(STOP, SEEN)
    assert guard.act(ALL) == STOP
    guard.observe(STOP, SEEN)
    assert slow.calls == ["begin"]
    slow.gate.set()
    assert guard.explain() == ("why not",)  # waits for all that is under way
    assert slow.calls == ["begin", "act", "stop", "act", "stop"]
    assert guard.times_late == 2


def test_where_the_fallback_is_not_allowed_the_decision_is_waited_for() -> None:
    slow = Slow()
    guard = guarded(slow)

    def open_when_late() -> None:
        while guard.times_late == 0:
            time.sleep(0.01)
        slow.gate.set()

    threading.Thread(target=open_when_late).start()
    assert guard.act(np.array([False, True])) == GO
    assert guard.times_late == 1


def test_what_a_strategy_raises_comes_out_with_the_next_call() -> None:
    class Broken(Slow):
        def update(self) -> None:
            raise InputError("the observed state is none of the case's")

    guard = guarded(Broken())
    guard.update()
    with pytest.raises(InputError, match="none of the case's"):
        guard.policy()


def test_a_strategy_in_time_adapts_as_it_does_unguarded() -> None:
    """Four episodes of the running example: with the same seeds the returns are equal."""
    case = load_case("models/running-example")
    met, space = case.system("met"), hypothesis_space(case)

    def returns(*, guard: bool) -> list[float]:
        system = SimulatedSystem(met, 40, np.random.default_rng(1), detect=True)
        strategy = BeliefStrategy(space, 40, np.random.default_rng(2))
        acting = GuardedStrategy(strategy, case.actions, deadline=60, fallback="stop") if guard else strategy
        return [episode(system, acting) for _ in range(4)]

    assert returns(guard=True) == returns(guard=False)


@pytest.mark.parametrize(
    ("deadline", "fallback", "message"),
    [(0, "stop", "a positive number of seconds"), (1, "flee", "no action 'flee' to fall back on")],
)
def test_settings_that_make_no_sense_are_refused(deadline: float, fallback: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        GuardedStrategy(Slow(), ACTIONS, deadline=deadline, fallback=fallback)
