"""The protocol of an adaptation: episodes of a strategy on a system, and a row after every policy update."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from merap.strategies.evaluation import Evaluator, Row
from merap.systems.interface import ManagedSystem
from merap.systems.strategy import Strategy


def adaptation_rows(
    system: ManagedSystem, strategy: Strategy, evaluate: Evaluator, max_episodes: int
) -> Iterator[Row]:
    """Let a strategy adapt; yield a row before any episode and one after every policy update.

    Args:
        system: the system to adapt to.
        strategy: the caller may ask it to explain between rows.
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
    """Play one real episode under a strategy; return its undiscounted return."""
    observation = system.reset()
    strategy.begin(observation)
    total = 0.0
    while not observation.last:
        action = strategy.act(observation.enabled)
        observation = system.step(action)
        strategy.observe(action if observation.taken is None else observation.taken, observation)
        total += observation.reward
    return total
