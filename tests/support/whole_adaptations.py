"""A whole adaptation with its scores."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from merap.mdp.model import Floats, TabularMDP
from merap.strategies.adaptation import Adaptation
from merap.strategies.evaluation import Evaluator, Range, Run, judged
from merap.strategies.protocol import adaptation_rows
from merap.systems.interface import ManagedSystem
from merap.systems.strategy import Strategy
from tests.support.grid_tasks import HORIZON


def adapted(
    seed: int,
    system: ManagedSystem,
    strategy: Strategy,
    evaluate: Evaluator,
    reachable: Range,
    max_episodes: int,
) -> Run:
    """Adapt, and score the run; see `protocol.adaptation` and `evaluation.judged`."""
    return judged(seed, list(adaptation_rows(system, strategy, evaluate, max_episodes)), reachable)


def values(found: Adaptation, run: int = 0) -> Sequence[float]:
    return [row.expected_return for row in found.runs[run].curve]


def moments(model: TabularMDP, policy: Floats) -> tuple[float, float]:
    """Mean and variance of an episode's return in a deterministic model, forward by hand.

    The distribution over states and its first two moments of the return so far:
    E[(G + r)^2; s'] = E[G^2; s] + 2 r E[G; s] + r^2 P(s).

    Args:
        model: canonical.
        policy: [S, A + 1], or [T, S, A + 1].
    """
    states, targets = model.choice_state, model.branch_target  # deterministic: one branch a choice
    assert model.num_branches == model.num_choices
    reward = model.choice_reward
    mass: Floats = model.initial
    first: Floats = np.zeros(model.num_states)
    second: Floats = np.zeros(model.num_states)

    def arriving(weights: Floats) -> Floats:
        return np.bincount(targets, weights, model.num_states).astype(np.float64)

    for t in range(HORIZON):
        now = policy[t] if policy.ndim == 3 else policy
        # a float32 softmax sums to 1 up to 1e-7
        taken = (now / np.maximum(now.sum(axis=1, keepdims=True), 0.5))[states, model.choice_action]
        p, m, q = mass[states] * taken, first[states] * taken, second[states] * taken
        mass = arriving(p)
        first = arriving(m + reward * p)
        second = arriving(q + 2 * reward * m + reward**2 * p)
    mean = float(first.sum())
    return mean, float(second.sum()) - mean**2
