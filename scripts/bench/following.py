"""An adaptation that is followed until it is good enough, whatever the strategy is.

Every figure has the same definition for all strategies: see `curve.Run` and `Lengths`.
"""

from __future__ import annotations

from dataclasses import dataclass

from merap.concerns.case_study import CaseStudy
from merap.mdp.model import TabularMDP
from merap.strategies.evaluation import Range, Row, Run, evaluator, judged, lasting
from merap.strategies.protocol import adaptation_rows
from merap.systems.interface import ManagedSystem
from merap.systems.strategy import Strategy


@dataclass(frozen=True)
class NoiseCondition:
    """What makes it hard to learn from what a system shows.

    Attributes:
        name: in tables.
        noise: standard deviation of the Gaussian noise on rewards.
        slip: probability that an action does nothing.
    """

    name: str
    noise: float = 0.0
    slip: float = 0.0


UNDISTURBED = NoiseCondition("none")
CONDITIONS = (
    UNDISTURBED,
    NoiseCondition("noise", noise=0.5),
    NoiseCondition("slip", slip=0.1),
    NoiseCondition("both", noise=0.5, slip=0.1),
)


@dataclass(frozen=True)
class Lengths:
    """How long an adaptation is followed: until it is within 5 percent for good, but within these limits.

    Attributes:
        least: real episodes at least; regret is summed over the first that many.
        most: real episodes at most.
    """

    least: int = 10
    most: int = 60


def followed(
    seed: int,
    system: ManagedSystem,
    strategy: Strategy,
    model: TabularMDP,
    reachable: Range,
    horizon: int,
    lengths: Lengths,
) -> Run:
    """Run one adaptation; `strategy` is afterwards as it was left.

    Args:
        seed: of its episodes, as a name.
        system: what is met.
        strategy: what adapts to it.
        model: the true one, canonical, which scores.
        reachable: what any policy can earn on it.
        horizon: T.
        lengths: how long it is followed.
    """
    rows: list[Row] = []
    for row in adaptation_rows(system, strategy, evaluator(model, horizon), lengths.most):
        rows.append(row)
        near = [reachable.within_5_percent(one.expected_return) for one in rows]
        if row.episodes >= lengths.least and lasting(near) is not None:
            break
    return judged(seed, rows, reachable, regret_episodes=lengths.least)


def outside_of(case: CaseStudy) -> str:
    """Return the concerns, of `E`, `C` and `O`, in which an online system is not in the base."""
    system, supports = case.system("met"), case.supports
    pairs = (
        ("E", supports.environment, system.environment),
        ("C", supports.capability, system.capability),
        ("O", supports.objective, system.objective),
    )
    return "".join(letter for letter, support, part in pairs if support.index(part.name) is None)
