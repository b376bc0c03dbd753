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
from merap.concerns.case_study import DeclaredCase
from merap.families.index import family_index, index_kinds
from merap.strategies.evaluation import Run
from merap.strategies.ground_truth import GroundTruth, ground_truth
from merap.systems.simulated import SimulatedSystem
from scripts.bench.drawn_grids import drawn_case
from scripts.bench.following import Lengths, NoiseCondition, followed, outside_of


@dataclass(frozen=True, eq=False)
class BeliefProblem:
    """A system for the belief strategy to adapt to.

    Attributes:
        truth: the system as it really is.
        condition: of its episodes.
        hypotheses: of its case.
    """

    truth: GroundTruth
    condition: NoiseCondition
    hypotheses: HypothesisSpace

    def simulated(self, generator: np.random.Generator) -> SimulatedSystem:
        """Make the system."""
        condition, truth = self.condition, self.truth
        return SimulatedSystem(
            truth.system, truth.horizon, generator, slip=condition.slip, noise=condition.noise
        )


def belief_problem(case: DeclaredCase, condition: NoiseCondition) -> BeliefProblem:
    """Make the problem of the system `met` of a case."""
    system = case.system("met")
    truth = ground_truth(system, condition.slip)
    index = family_index(index_kinds([system.program]), case.actions, [truth.whole])
    return BeliefProblem(truth, condition, hypothesis_space(case, index=index))


def followed_belief(problem: BeliefProblem, seed: int, lengths: Lengths) -> tuple[Run, BeliefStrategy]:
    """Adapt once; return the run, and the strategy after it."""
    of_system, of_strategy = np.random.default_rng(seed).spawn(2)
    truth = problem.truth
    strategy = BeliefStrategy(problem.hypotheses, truth.horizon, of_strategy)
    simulated = problem.simulated(of_system)
    model = truth.model_on(problem.hypotheses.index)
    run = followed(seed, simulated, strategy, model, truth.reachable, truth.horizon, lengths)
    return run, strategy


def drawn_figures(
    numbers: Sequence[int], condition: NoiseCondition, lengths: Lengths, folder: Path
) -> Iterator[dict[str, Any]]:
    """Adapt once to the online system of each drawn case; yield a row for each.

    Args:
        numbers: of the cases.
        condition: under which.
        lengths: how long each is followed.
        folder: where case files may be written.
    """
    for number in numbers:
        case = drawn_case(number, folder)
        problem = belief_problem(case, condition)
        run, strategy = followed_belief(problem, number, lengths)
        yield {
            "case": case.name,
            "condition": condition.name,
            "outside": outside_of(case),
            "locations": case.space.num_locations,
            "models": case.size,
            "optimum": problem.truth.reachable.optimum,
            "final": run.curve[-1].expected_return,
            "episodes": run.episodes_to_within_5_percent,
            "regret": run.sampled_regret,
            "explanation": strategy.explain(),
        }
