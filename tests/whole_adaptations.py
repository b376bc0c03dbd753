"""A whole adaptation with its scores."""

from __future__ import annotations

from merap.online.curve import Range, Run, judged
from merap.online.running import Evaluator, adaptation
from merap.online.strategy import Strategy
from merap.online.systems import ManagedSystem


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
