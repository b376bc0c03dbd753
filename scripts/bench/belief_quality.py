"""How soon `belief` gets there on drawn cases, and how long it thinks, with slip and noise on rewards.

The strategy acts on its plans alone here: no meta policy is trained for these tables. For cases with one see
`strategy_quality`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.mdp.model import TabularMDP
from merap.strategies.evaluation import Range, Run
from merap.strategies.protocol import reachable_range
from merap.systems.simulated import SimulatedSystem
from merap.systems.slip import slipping_model
from scripts.bench.drawn_grids import drawn_case
from scripts.bench.following import Lengths, NoiseCondition, followed, outside_of


@dataclass(frozen=True, eq=False)
class Meeting:
    """A system under a condition, and all that strategies and scores are made from.

    Attributes:
        system: what is met.
        condition: under which.
        hypotheses: of its case.
        model: the true one, slip included.
        reachable: what any policy can earn.
    """

    system: Combination
    condition: NoiseCondition
    hypotheses: HypothesisSpace
    model: TabularMDP
    reachable: Range


def meeting(case: CaseStudy, condition: NoiseCondition) -> Meeting:
    """The system `met` of a case."""
    system = case.system("met")
    model = slipping_model(system, condition.slip)
    reachable = reachable_range(model, system.objective.horizon)
    return Meeting(system, condition, hypothesis_space(case), model, reachable)


def followed_belief(met: Meeting, seed: int, lengths: Lengths) -> tuple[Run, BeliefStrategy]:
    """One adaptation, and the strategy as it is after it."""
    of_system, of_strategy = np.random.default_rng(seed).spawn(2)
    horizon, condition = met.system.objective.horizon, met.condition
    strategy = BeliefStrategy(met.hypotheses, horizon, of_strategy)
    simulated = SimulatedSystem(met.system, horizon, of_system, slip=condition.slip, noise=condition.noise)
    return followed(seed, simulated, strategy, met.model, met.reachable, horizon, lengths), strategy


def drawn_figures(
    numbers: Sequence[int], condition: NoiseCondition, lengths: Lengths, folder: Path
) -> Iterator[dict[str, Any]]:
    """A row for each drawn case, met once.

    Args:
        numbers: of the cases.
        condition: under which.
        lengths: how long each is followed.
        folder: where case files may be written.
    """
    for number in numbers:
        case = drawn_case(number, folder)
        met = meeting(case, condition)
        run, strategy = followed_belief(met, number, lengths)
        yield {
            "case": case.name,
            "condition": condition.name,
            "outside": outside_of(case),
            "locations": case.space.num_locations,
            "models": case.size,
            "optimum": met.reachable.optimum,
            "final": run.curve[-1].expected_return,
            "episodes": run.episodes_to_within_5_percent,
            "regret": run.sampled_regret,
            "explanation": strategy.explain(),
        }
