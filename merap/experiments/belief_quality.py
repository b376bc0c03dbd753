"""How soon `belief` gets there: given cases and drawn ones, with slip and noise on rewards.

The strategy acts on its plans alone here: no meta policy is trained for these tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.experiments.drawn_grids import drawn_case
from merap.mdp.model import TabularMDP
from merap.online.belief.space import HypothesisSpace, hypothesis_space
from merap.online.belief.strategy import BeliefStrategy
from merap.online.curve import Range, Row, Run, judged, lasting, summary
from merap.online.managed.slip import slipping_model
from merap.online.running import adaptation, evaluator, reachable_range
from merap.online.systems import SimulatedSystem


@dataclass(frozen=True)
class Condition:
    """What makes it hard to learn from what a system shows.

    Attributes:
        name: in tables.
        noise: standard deviation of the Gaussian noise on rewards.
        slip: probability that an action does nothing.
    """

    name: str
    noise: float = 0.0
    slip: float = 0.0


CONDITIONS = (
    Condition("none"),
    Condition("noise", noise=0.5),
    Condition("slip", slip=0.1),
    Condition("both", noise=0.5, slip=0.1),
)


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
    condition: Condition
    hypotheses: HypothesisSpace
    model: TabularMDP
    reachable: Range


def meeting(case: CaseStudy, condition: Condition, hypotheses: HypothesisSpace | None = None) -> Meeting:
    """The system `met` of a case; its hypotheses are the same for every condition and may be given."""
    system = case.system("met")
    model = slipping_model(system, condition.slip)
    reachable = reachable_range(model, system.objective.horizon)
    return Meeting(system, condition, hypotheses or hypothesis_space(case), model, reachable)


@dataclass(frozen=True)
class Lengths:
    """How long an adaptation is followed: until it is within 5 percent for good, but within these limits.

    Attributes:
        least: real episodes at least, over which regret is summed.
        most: real episodes at most.
    """

    least: int = 10
    most: int = 60


def followed(met: Meeting, seed: int, lengths: Lengths) -> tuple[Run, BeliefStrategy]:
    """One adaptation, and the strategy as it is after it."""
    of_system, of_strategy = np.random.default_rng(seed).spawn(2)
    horizon, condition, reachable = met.system.objective.horizon, met.condition, met.reachable
    strategy = BeliefStrategy(met.hypotheses, horizon, of_strategy)
    simulated = SimulatedSystem(met.system, horizon, of_system, slip=condition.slip, noise=condition.noise)
    rows: list[Row] = []
    for row in adaptation(simulated, strategy, evaluator(met.model, horizon), lengths.most):
        rows.append(row)
        near = [reachable.within_5_percent(one.expected_return) for one in rows]
        if row.episodes >= lengths.least and lasting(near) is not None:
            break
    return judged(seed, rows, reachable), strategy


def regret(met: Meeting, run: Run, episodes: int) -> float:
    """Optimum minus what the first real episodes returned, summed: with exploration, noise and luck."""
    returns = [row.sampled_return for row in run.curve[1 : episodes + 1] if row.sampled_return is not None]
    return sum(met.reachable.optimum - earned for earned in returns)


def case_figures(
    case: CaseStudy, conditions: Sequence[Condition], seeds: Sequence[int], lengths: Lengths
) -> Iterator[dict[str, Any]]:
    """A row for each condition: `curve.summary` over the seeds, and regrets."""
    hypotheses = hypothesis_space(case)
    for condition in conditions:
        met = meeting(case, condition, hypotheses)
        runs = [followed(met, seed, lengths)[0] for seed in seeds]
        yield {
            "case": case.name,
            "condition": condition.name,
            "outside": outside_of(case),
            "optimum": met.reachable.optimum,
            "regret_of_first": float(np.mean([regret(met, run, 1) for run in runs])),
            "regret_of_least": float(np.mean([regret(met, run, lengths.least) for run in runs])),
            **summary(runs),
        }


def drawn_figures(
    numbers: Sequence[int], condition: Condition, lengths: Lengths, folder: Path
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
        run, strategy = followed(met, number, lengths)
        yield {
            "case": case.name,
            "condition": condition.name,
            "outside": outside_of(case),
            "locations": case.space.num_locations,
            "models": case.size,
            "optimum": met.reachable.optimum,
            "final": run.curve[-1].expected_return,
            "episodes": run.episodes_to_within_5_percent,
            "regret": regret(met, run, lengths.least),
            "explanation": strategy.explain(),
        }


def outside_of(case: CaseStudy) -> str:
    """The concerns in which what is met is not in the base: of `E`, `C` and `O`."""
    system, supports = case.system("met"), case.supports
    pairs = (
        ("E", supports.environment, system.environment),
        ("C", supports.capability, system.capability),
        ("O", supports.objective, system.objective),
    )
    return "".join(letter for letter, support, part in pairs if support.index(part.name) is None)
