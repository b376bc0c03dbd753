from __future__ import annotations

import numpy as np
import pytest

from merap.errors import InputError, ModelError
from merap.mdp.evaluation import as_policy
from merap.mdp.index import index_of
from merap.mdp.model import Bools, Floats
from merap.mdp.planning import backward_induction
from merap.strategies.evaluation import evaluator, executed, reachable_range
from merap.strategies.protocol import adaptation_rows
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from merap.systems.strategy import StateIndex, best_allowed
from tests.support.grid_tasks import HORIZON, grid_model, grid_task
from tests.support.whole_adaptations import adapted

MODEL = grid_model(grid_task((0, 2)))


class Fixed:
    """Takes one action; counts what it is told."""

    def __init__(self, action: int, episodes_per_update: int = 2) -> None:
        self.action, self.episodes_per_update = action, episodes_per_update
        self.calls: list[str] = []

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        assert observation.reward == 0
        self.calls.append("begin")

    def act(self, allowed: Bools) -> int:
        assert allowed[self.action]
        return self.action

    def observe(self, action: int, observation: Observation) -> None:
        self.calls.append("last" if observation.last else "step")

    def update(self) -> None:
        self.calls.append("update")

    def policy(self) -> Floats:
        return np.broadcast_to(np.eye(5)[self.action], (MODEL.num_states, 5))

    def explain(self) -> tuple[str, ...]:
        return ("always the same",)


def test_rows_count_updates_and_real_episodes() -> None:
    strategy = Fixed(0)
    system = SimulatedSystem(MODEL, HORIZON, np.random.default_rng(0))
    rows = list(adaptation_rows(system, strategy, evaluator(MODEL, HORIZON), 5))
    assert [(row.step, row.episodes) for row in rows] == [(0, 0), (1, 2), (2, 4)]
    # 18 steps at -0.5, by the policy's exact value and in the episodes.
    assert [row.expected_return for row in rows] == [-9, -9, -9]
    assert [row.sampled_return for row in rows] == [None, -9, -9]
    one_episode = ["begin", *["step"] * (HORIZON - 1), "last"]
    assert strategy.calls == (one_episode * 2 + ["update"]) * 2


def test_a_run_is_judged() -> None:
    system = SimulatedSystem(MODEL, HORIZON, np.random.default_rng(0))
    reachable = reachable_range(MODEL, HORIZON)
    # Two steps away: 10 - 0.5 * 2; at worst 18 steps without the goal.
    assert (reachable.optimum, reachable.worst) == (9, -9)
    run = adapted(7, system, Fixed(0), evaluator(MODEL, HORIZON), reachable, 6)
    assert run.seed == 7
    assert run.episodes_to_within_5_percent is None


def test_a_time_indexed_policy_has_its_plans_value() -> None:
    found = backward_induction(MODEL, HORIZON)
    policy = as_policy(MODEL, found.actions)[..., :-1]
    assert evaluator(MODEL, HORIZON)(policy) == pytest.approx(found.value)


def test_what_is_disabled_is_shared_out() -> None:
    policy = np.full((MODEL.num_states, 5), 0.2)
    carried_out = executed(MODEL, policy)
    assert carried_out[-1].tolist() == [0, 0, 0, 0, 0, 1]
    nowhere = executed(MODEL, np.zeros((MODEL.num_states, 5)))
    assert nowhere[0].tolist() == [0.2] * 5 + [0]


@pytest.mark.parametrize(
    "policy", [np.ones((3, 5)), np.full((82, 5), -1.0), np.full((82, 5), np.nan), np.ones((82, 6))]
)
def test_what_is_no_policy_is_refused(policy: Floats) -> None:
    with pytest.raises(ModelError):
        executed(MODEL, policy)


def test_states_are_found_by_their_values() -> None:
    index = StateIndex(index_of(MODEL))
    seen = Observation(np.array([2, 3]), np.ones(5, dtype=np.bool_), 0.0, 1.0, False)
    assert index(seen) == 2 * 9 + 3
    ended = Observation(np.array([2, 3]), np.ones(5, dtype=np.bool_), 0.0, 0.0, False)
    assert index(ended) == 81  # completed
    with pytest.raises(InputError, match=r"\(9, 9\) is none of the 81 known ones"):
        index(Observation(np.array([9, 9]), np.ones(5, dtype=np.bool_), 0.0, 1.0, False))


def test_the_best_allowed_action() -> None:
    assert best_allowed(np.array([3.0, 2.0, 1.0]), np.array([False, True, True])) == 1
