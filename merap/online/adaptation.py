"""The online phase: adapt the meta policy to a system by gradient steps (`eq:adaptation`).

Axes: B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
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
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.online.curve import Range, Row, Run, as_dict, judged, summary

GRADIENT = "gradient"


@dataclass(frozen=True, eq=False)
class Adaptation:
    """Several adaptations to one system, which differ in their seed.

    Attributes:
        system: its name.
        strategy: how it was adapted to.
        reachable: what any policy can earn there.
        runs: one for each seed.
        before: float64 [S, A + 1], the meta policy; the last action is `end`.
        after: likewise, the policy of the first run after its last step.
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
    episodes_per_step: int = 35,
    steps: int = 30,
    seeds: Sequence[int] = (0,),
    on_step: Callable[[], None] = lambda: None,
) -> Adaptation:
    """Adapt a run's meta policy to a simulated system by gradient steps, once for each seed.

    What a seed gives does not depend on the others.

    Args:
        run: a finished training run.
        system: an online system or a combination of the run's case.
        episodes_per_step: B.
        steps: gradient steps.
        seeds: of the episodes.
        on_step: called after each gradient step of each seed.

    Raises:
        InputError: the run is not finished, or there is no seed.
    """
    if not seeds:
        raise InputError("there is no seed to adapt with")
    meta = read_policy(run, tasks_of(run))
    model = model_of(system)
    horizon = system.objective.horizon
    tasks = task_batch([model], horizon, system.discount)
    reachable = Range(optimum(model, horizon), worst_value(model, horizon))
    runs, last = [], meta.parameters
    for index, seed in enumerate(seeds):
        curve, parameters = [], meta.parameters
        for row, parameters in _steps(meta, model, tasks, episodes_per_step, steps, seed):  # noqa: B007
            curve.append(row)
            on_step()
        runs.append(judged(seed, curve, reachable))
        last = parameters if index == 0 else last
    return Adaptation(
        system=system.name,
        strategy=GRADIENT,
        reachable=reachable,
        runs=tuple(runs),
        before=_acting(meta, stack_parameters(meta.parameters, 1), tasks),
        after=_acting(meta, last, tasks),
        model=model,
    )


def _steps(
    meta: MetaPolicy, model: TabularMDP, tasks: TaskBatch, num_episodes: int, steps: int, seed: int
) -> Iterator[tuple[Row, Parameters]]:
    """Row 0, then one after each gradient step, with the parameters of that moment."""
    generator = torch.Generator().manual_seed(seed)
    system = sampler(tasks)
    parameters = stack_parameters(meta.parameters, 1)
    yield Row(0, 0, _value(meta, parameters, tasks, model), None), parameters
    for step in range(1, steps + 1):
        acting = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
        episodes = rollout(acting, system, num_episodes, generator)
        parameters = _stepped(meta, parameters, tasks.enabled, episodes)
        value = _value(meta, parameters, tasks, model)
        yield Row(step, step * num_episodes, value, episodes.returns.mean().item()), parameters


def _stepped(meta: MetaPolicy, parameters: Parameters, enabled: Tensor, episodes: Episodes) -> Parameters:
    return sampled_step(
        meta.network, parameters, meta.step_sizes, enabled, episodes, meta.rule, meta.variance
    ).parameters


def _value(meta: MetaPolicy, parameters: Parameters, tasks: TaskBatch, model: TabularMDP) -> float:
    """The exact undiscounted value over the horizon, in double precision."""
    return expected_return(model, _acting(meta, parameters, tasks), tasks.horizon)


def _acting(meta: MetaPolicy, parameters: Parameters, tasks: TaskBatch) -> Floats:
    """The policy that acts when learning has stopped, over all actions of the model."""
    with torch.no_grad():
        table = policy_table(meta.network, parameters, tasks.enabled)[0].double().numpy()
    ending = ~tasks.enabled[0].any(dim=-1).numpy()
    return np.column_stack([table, ending])
