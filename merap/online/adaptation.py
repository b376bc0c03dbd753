"""The online phase: adapt to a system that is met, by one of several strategies.

Axes: B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, islice
from typing import Any

import numpy as np
import torch
from torch import Tensor

from merap.base.build import model_of
from merap.concerns.combination import Combination
from merap.errors import InputError
from merap.learning.checkpoint import read_policy
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy
from merap.learning.policy import Parameters, policy_table, stack_parameters
from merap.learning.rollout import Episodes, rollout, sampler
from merap.learning.run_folder import RunFolder
from merap.learning.running import tasks_of
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.threads import one_thread
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats, TabularMDP
from merap.online.belief.space import hypothesis_space
from merap.online.belief.strategy import BeliefStrategy
from merap.online.curve import Range, Row, Run, as_dict, judged, summary
from merap.online.running import adaptation, evaluator, executed, reachable_range
from merap.online.systems import SimulatedSystem

GRADIENT = "gradient"
BELIEF = "belief"
STRATEGIES = (GRADIENT, BELIEF)
MAX_EPISODES = 1_000_000


@dataclass(frozen=True, eq=False)
class Adaptation:
    """Several adaptations to one system, which differ in their seed.

    Attributes:
        system: its name.
        strategy: how it was adapted to.
        reachable: what any policy can earn there.
        runs: one for each seed.
        before: float64 [S, A + 1] or [T, S, A + 1], the policy of the first run before any
            episode; the last action is `end`.
        after: likewise, after its last update.
        model: the system's true model, on the canonical index.
    """

    system: str
    strategy: str
    reachable: Range
    runs: tuple[Run, ...]
    before: Floats = field(repr=False)
    after: Floats = field(repr=False)
    model: TabularMDP = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "system": self.system,
            "strategy": self.strategy,
            "optimum": self.reachable.optimum,
            "worst": self.reachable.worst,
            "runs": [as_dict(run) for run in self.runs],
            "summary": summary(self.runs),
        }


def adapt(
    run: RunFolder,
    system: Combination,
    *,
    strategy: str = GRADIENT,
    episodes_per_step: int = 35,
    steps: int = 30,
    seeds: Sequence[int] = (0,),
    on_step: Callable[[], None] = lambda: None,
) -> Adaptation:
    """Adapt to a simulated system, once for each seed.

    What a seed gives does not depend on the others.

    Args:
        run: a finished training run.
        system: an online system or a combination of the run's case.
        strategy: `gradient` (gradient steps from the meta policy, `eq:adaptation`) or `belief` (a
            posterior over what the domain may be, updated after each episode).
        episodes_per_step: B, of `gradient`.
        steps: policy updates.
        seeds: of the episodes.
        on_step: called after each policy update of each seed.

    Raises:
        InputError: the run is not finished, there is no seed, or no such strategy.
    """
    if not seeds:
        raise InputError("there is no seed to adapt with")
    if strategy not in STRATEGIES:
        raise InputError(f"there is no strategy {strategy!r}; allowed: {', '.join(STRATEGIES)}")
    model = model_of(system)
    reachable = reachable_range(model, system.objective.horizon)
    runs, policies = [], []
    with one_thread():
        adaptations = (
            _gradient(run, system, model, episodes_per_step)
            if strategy == GRADIENT
            else _belief(run, system, model)
        )
        for seed in seeds:
            rows = []
            for row, policy in islice(adaptations(seed), steps + 1):
                rows.append((row, policy))
                if row.step:
                    on_step()
            runs.append(judged(seed, [row for row, _ in rows], reachable))
            policies.append((rows[0][1], rows[-1][1]))
    before, after = policies[0]
    return Adaptation(system.name, strategy, reachable, tuple(runs), before, after, model)


# By seed: rows without end, with the policy that would act then.
Adaptations = Callable[[int], Iterator[tuple[Row, Floats]]]


def _belief(run: RunFolder, system: Combination, model: TabularMDP) -> Adaptations:
    space = hypothesis_space(run.case)
    horizon = system.objective.horizon
    evaluate = evaluator(model, horizon)

    def adaptations(seed: int) -> Iterator[tuple[Row, Floats]]:
        of_system, of_strategy = np.random.default_rng(seed).spawn(2)
        strategy = BeliefStrategy(space, horizon, of_strategy)
        simulated = SimulatedSystem(model, horizon, of_system)
        for row in adaptation(simulated, strategy, evaluate, MAX_EPISODES):
            yield row, executed(model, strategy.policy())

    return adaptations


def _gradient(run: RunFolder, system: Combination, model: TabularMDP, num_episodes: int) -> Adaptations:
    meta = read_policy(run, tasks_of(run))
    tasks = task_batch([model], system.objective.horizon, system.discount)
    simulated = sampler(tasks)

    def adaptations(seed: int) -> Iterator[tuple[Row, Floats]]:
        generator = torch.Generator().manual_seed(seed)
        parameters = stack_parameters(meta.parameters, 1)
        sampled_return = None
        for step in count():
            policy = _acting(meta, parameters, tasks)
            value = expected_return(model, policy, tasks.horizon)
            yield Row(step, step * num_episodes, value, sampled_return), policy
            exploring = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
            episodes = rollout(exploring, simulated, num_episodes, generator)
            sampled_return = episodes.returns.mean().item()
            parameters = _stepped(meta, parameters, tasks.enabled, episodes)

    return adaptations


def _stepped(meta: MetaPolicy, parameters: Parameters, enabled: Tensor, episodes: Episodes) -> Parameters:
    return sampled_step(
        meta.network, parameters, meta.step_sizes, enabled, episodes, meta.rule, meta.variance
    ).parameters


def _acting(meta: MetaPolicy, parameters: Parameters, tasks: TaskBatch) -> Floats:
    """The policy that acts when learning has stopped, over all actions of the model."""
    with torch.no_grad():
        table = policy_table(meta.network, parameters, tasks.enabled)[0].double().numpy()
    ending = ~tasks.enabled[0].any(dim=-1).numpy()
    return np.column_stack([table, ending])
