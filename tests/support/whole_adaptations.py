"""A whole adaptation with its scores."""

from __future__ import annotations

from merap.strategies.evaluation import Range, Run, judged
from merap.strategies.protocol import Evaluator, adaptation
from merap.systems.interface import ManagedSystem
from merap.systems.strategy import Strategy


def adapted(
    seed: int,
    system: ManagedSystem,
    strategy: Strategy,
    evaluate: Evaluator,
    reachable: Range,
    max_episodes: int,
) -> Run:
    """See `running.adaptation` and `curve.judged`."""
    return judged(seed, list(adaptation(system, strategy, evaluate, max_episodes)), reachable)
