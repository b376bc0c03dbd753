"""Run a strategy against a system, and record the curve of its adaptation.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from merap.errors import ModelError
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.strategies.evaluation import Range, Row
from merap.systems.interface import ManagedSystem
from merap.systems.strategy import Strategy

Evaluator = Callable[[Floats], float]


def reachable_range(model: TabularMDP, horizon: int) -> Range:
    """What time-indexed policies can earn on a model."""
    return Range(optimum(model, horizon), worst_value(model, horizon))


def evaluator(model: TabularMDP, horizon: int) -> Evaluator:
    """The exact undiscounted value of a strategy's policy on the true model, which strategies never see.

    Args:
        model: the true one, canonical.
        horizon: T.
    """
    return lambda policy: expected_return(model, executed(model, policy), horizon)


def executed(model: TabularMDP, policy: Floats) -> Floats:
    """A strategy's policy as the system carries it out.

    Args:
        model: canonical: its last action is `end`.
        policy: float64 [..., S, A], over declared actions.

    Returns:
        float64 [..., S, A + 1]: zero where an action is disabled, the rest in proportion,
        uniform where nothing is left; `end` in completed states.

    Raises:
        ModelError: the policy has another shape, or a negative or undefined entry.
    """
    if policy.shape[-2:] != (model.num_states, model.num_actions - 1):
        expected = (model.num_states, model.num_actions - 1)
        raise ModelError(f"the policy has shape {policy.shape}, not (.., {expected[0]}, {expected[1]})")
    if not np.all(policy >= 0):
        raise ModelError("the policy has a probability that is negative or undefined")
    widened = np.concatenate([policy, np.zeros((*policy.shape[:-1], 1))], axis=-1) * model.enabled
    nothing_left = widened.sum(axis=-1, keepdims=True) == 0
    widened = np.where(nothing_left, model.enabled * 1.0, widened)
    widened[..., model.labels[COMPLETE_LABEL], -1] = 1.0
    shares: Floats = widened / np.maximum(widened.sum(axis=-1, keepdims=True), 1e-300)
    return shares


def adaptation(
    system: ManagedSystem, strategy: Strategy, evaluate: Evaluator, max_episodes: int
) -> Iterator[Row]:
    """Let a strategy adapt; a row after every policy update, row 0 before any episode.

    Args:
        system: what is met.
        strategy: what adapts; the caller may ask it to explain between rows.
        evaluate: scores its policies.
        max_episodes: no update begins that would need more real episodes.
    """
    yield Row(0, 0, evaluate(strategy.policy()), None)
    for step in range(1, max_episodes // strategy.episodes_per_update + 1):
        returns = [episode(system, strategy) for _ in range(strategy.episodes_per_update)]
        strategy.update()
        yield Row(
            step,
            step * strategy.episodes_per_update,
            evaluate(strategy.policy()),
            float(np.mean(returns)),
        )


def episode(system: ManagedSystem, strategy: Strategy) -> float:
    """One real episode under a strategy; its undiscounted return."""
    observation = system.reset()
    strategy.begin(observation)
    total = 0.0
    while not observation.last:
        action = strategy.act(observation.enabled)
        observation = system.step(action)
        strategy.observe(action if observation.taken is None else observation.taken, observation)
        total += observation.reward
    return total
