"""The policy after gradient steps, with its parameters, for use elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.concerns.combination import Combination
from merap.families.build import ModelBase
from merap.learning.meta import MetaPolicy
from merap.learning.threads import one_thread
from merap.runs.run_folder import RunFolder
from merap.strategies.adaptation import OnStep
from merap.strategies.gradient import GradientStrategy
from merap.strategies.problem import adaptation_problem
from merap.strategies.protocol import episode


def adapted_policy(
    run: RunFolder,
    system: Combination,
    *,
    steps: int,
    episodes_per_step: int = 35,
    seed: int = 0,
    on_step: OnStep = lambda: None,
) -> tuple[MetaPolicy, ModelBase]:
    """Return the meta policy after gradient steps on a simulated system, those of `adapt` with this seed.

    The base beside it holds the states of the system, too.

    Args:
        run: a finished training run.
        system: an online system or a combination of the run's case.
        steps: gradient steps; 0 gives the meta policy.
        episodes_per_step: B.
        seed: seed of the episodes.
        on_step: called after each step.

    Raises:
        InputError: the run is not finished, or the system can't begin another episode.
    """
    problem = adaptation_problem(run, system, episodes_per_step=episodes_per_step)
    of_system, of_strategy = np.random.default_rng(seed).spawn(2)
    meta = problem.context.meta
    strategy = GradientStrategy(meta, problem.context.index, episodes_per_step, of_strategy)
    with one_thread():
        simulated = problem.simulated(of_system)
        for _ in range(steps):
            for _ in range(episodes_per_step):
                episode(simulated, strategy)
            strategy.update()
            on_step()
    return replace(meta, parameters=strategy.parameters), problem.context.base
