"""How soon each adaptation strategy gets there, and what it costs until then."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from merap.learning.threads import one_thread
from merap.runs.run_folder import RunFolder
from merap.strategies.adaptation import best_median_worst, values_of_pretrained
from merap.strategies.evaluation import Run, summary
from merap.strategies.problem import AdaptationProblem, Conditions, adaptation_problem
from merap.strategies.registry import ALL, PRETRAINED, STRATEGIES
from scripts.bench.following import Lengths, NoiseCondition, followed, outside_of

COMPARED = tuple(f"{name}:{ALL}" if name == PRETRAINED else name for name in STRATEGIES)


def strategy_figures(
    run: RunFolder,
    strategies: Sequence[str],
    condition: NoiseCondition,
    seeds: Sequence[int],
    lengths: Lengths,
    episodes_per_step: int,
) -> Iterator[dict[str, Any]]:
    """Yield a row for each strategy on the system `met` of a run's case; three for `pretrained:all`.

    Args:
        run: a finished training run.
        strategies: their names.
        condition: under which the system is problem.
        seeds: of the adaptations.
        lengths: how long each is followed.
        episodes_per_step: real episodes of a gradient step.
    """
    conditions = Conditions(condition.noise, condition.slip)
    problem = adaptation_problem(
        run, run.case.system("met"), episodes_per_step=episodes_per_step, conditions=conditions
    )
    for name in strategies:
        began = time.perf_counter()
        played = _played(problem, name)
        prepared = time.perf_counter() - began
        for shown, strategy in played.items():
            began = time.perf_counter()
            with one_thread():
                runs = [_followed(problem, strategy, seed, lengths) for seed in seeds]
            yield {
                "case": run.case.name,
                "condition": condition.name,
                "outside": outside_of(run.case),
                "strategy": shown,
                "played": strategy,
                "optimum": problem.truth.reachable.optimum,
                "regret_episodes": lengths.least,
                "seconds_to_prepare": prepared,
                "seconds_per_seed": (time.perf_counter() - began) / len(seeds),
                **summary(runs),
            }


def _played(problem: AdaptationProblem, name: str) -> dict[str, str]:
    """Return the strategies that a name stands for, each by its name in tables; learn policies first."""
    if name != f"{PRETRAINED}:{ALL}":
        problem.strategy(name, np.random.default_rng(0))
        return {name: name}
    chosen = best_median_worst(values_of_pretrained(problem))
    places = zip(("best", "median", "worst"), chosen, strict=True)
    return {f"{PRETRAINED}, {place}": f"{PRETRAINED}:{combination}" for place, combination in places}


def _followed(problem: AdaptationProblem, name: str, seed: int, lengths: Lengths) -> Run:
    of_system, of_strategy = np.random.default_rng(seed).spawn(2)
    strategy, simulated = problem.strategy(name, of_strategy), problem.simulated(of_system)
    return followed(
        seed,
        simulated,
        strategy,
        problem.truth.model_on(problem.context.index),
        problem.truth.reachable,
        problem.context.horizon,
        lengths,
    )
