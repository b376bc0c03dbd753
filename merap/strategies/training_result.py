"""Compare the policies that a training run adapts with the best ones: was anything learned?

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from merap.families.build import ModelBase
from merap.learning.episodes import rollout
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.policy import policy_table, stack_parameters
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.runs.checkpoint import read_policy
from merap.runs.run_folder import RunFolder, read_base
from merap.runs.train import batch_of
from merap.strategies.evaluation import executed

# Number of tasks that are looked at, spread evenly over the base.
MOST_TASKS = 64
# Part of the way from acting at random to the optimum below which a run is said to have learned little.
ENOUGH = 0.5
# Part of the greatest probability of an end that counts as none.
NEVER = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class TrainingResult(ShortRepr):
    """Exact undiscounted values on the tasks of a run, over their horizons.

    Attributes:
        names: names of the N tasks.
        adapted: float64 [N], of the meta policy after its inner steps on real episodes of the task.
        optimum: float64 [N], of the best policy.
        random: float64 [N], of acting uniformly at random.
        ending: float64 [N], probability that the adapted policy ends the task within the horizon.
        endable: float64 [N], the greatest such probability.
    """

    names: tuple[str, ...]
    adapted: Floats
    optimum: Floats
    random: Floats
    ending: Floats
    endable: Floats

    @property
    def far_from_optimum(self) -> bool:
        """Whether adapted policies gain less than half as much as the best ones over acting at random."""
        return self.gain < ENOUGH

    @property
    def never_ends(self) -> bool:
        """Whether every adapted policy goes on to the horizon, though its task could be ended."""
        chances = self.ending[self.endable > 0] / self.endable[self.endable > 0]
        return len(chances) > 0 and bool(chances.max() < NEVER)

    @property
    def gain(self) -> float:
        """Gain of adapted policies over acting at random, as a part of the best policies' gain."""
        possible = self.optimum.mean() - self.random.mean()
        return float((self.adapted.mean() - self.random.mean()) / possible) if possible > 0 else 1.0


def evaluate_training(run: RunFolder) -> TrainingResult:
    """Adapt the policy of a finished run to its tasks, and evaluate it exactly.

    A base of more than `MOST_TASKS` tasks is judged by that many of them.

    Raises:
        InputError: training has not ended, or a file of the run is damaged.
    """
    spread = np.linspace(0, len(run.names) - 1, min(len(run.names), MOST_TASKS)).astype(int)
    base = read_base(run, [run.names[index] for index in spread])
    policies = _adapted(run, base)
    ending = replace(base, models=tuple(map(_ending, base.models)))
    return TrainingResult(
        names=base.names,
        adapted=_values(base, policies),
        optimum=_optima(base),
        random=_values(base, np.ones_like(policies)),
        ending=_values(ending, policies),
        endable=_optima(ending),
    )


def _adapted(run: RunFolder, base: ModelBase) -> Floats:
    """Return float64 [N, S, A], the policies after the inner steps that the run was trained for."""
    tasks = batch_of(base)
    meta, generator = read_policy(run, tasks), torch.Generator().manual_seed(run.config.seed)
    parameters = stack_parameters(meta.parameters, len(base.models))
    with torch.no_grad():
        for _ in range(run.config.inner_steps):
            policy = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
            episodes = rollout(policy, tasks, run.config.episodes, generator)
            parameters = sampled_step(
                meta.network, parameters, meta.step_sizes, tasks.enabled, episodes, meta.rule, meta.variance
            ).parameters
        policies: Floats = policy_table(meta.network, parameters, tasks.enabled).double().numpy()
    return policies


def _values(base: ModelBase, policies: Floats) -> Floats:
    tasks = zip(base.models, policies, base.horizons, strict=True)
    return np.array(
        [expected_return(model, executed(model, policy), horizon) for model, policy, horizon in tasks]
    )


def _optima(base: ModelBase) -> Floats:
    tasks = zip(base.models, base.horizons, strict=True)
    return np.array([optimum(model, horizon) for model, horizon in tasks])


def _ending(model: TabularMDP) -> TabularMDP:
    """Return the model with a reward of 1 for a step that ends the task, and no other."""
    done = model.labels[COMPLETE_LABEL]
    entering = model.branch_prob * done[model.branch_target]
    reward = np.bincount(model.branch_choice, entering, minlength=model.num_choices)
    return replace(model, choice_reward=np.where(done[model.choice_state], 0.0, reward), branch_reward=None)
