"""The meta policy, and its outer objective on a batch of tasks (`eq:mrl2`, `eq:meta-opt`).

A batch is worked on in ranges of tasks, which threads share. The ranges depend on sizes alone, and their
results are added up in order: what is learned does not depend on the number of threads.

Axes: N tasks, S states, A actions, P parameters in one row, L layers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import accumulate, pairwise

import numpy as np
import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.core import meta as core
from merap.learning.core.jit import Array, Numbers
from merap.learning.core.network import Network
from merap.learning.core.restrict import counting_entries, counting_states, restricted
from merap.learning.core.task import Tasks
from merap.learning.core.threads import on_threads
from merap.learning.gradient_step import StepRule
from merap.learning.layout import per_entry, per_parameter
from merap.learning.policy import Parameters, PolicyNetwork

# A range has at most so many tasks, and at most so many hidden units in all their states.
_RANGE = 8
_RANGE_NUMEL = 2**22


@dataclass(frozen=True, eq=False)
class MetaPolicy:
    """What training learns: where adaptation starts, and how far its steps go.

    Attributes:
        network: the policy's shape.
        parameters: theta.
        step_sizes: alpha for each of them, learned (Li et al. 2017, Meta-SGD), one number per
            weight or bias.
        variance: float [], of the advantages in training.
        rule: how episodes become a step.
    """

    network: PolicyNetwork
    parameters: Parameters
    step_sizes: Parameters
    variance: Tensor
    rule: StepRule


def step_rule(config: TrainingConfig, discount: float) -> StepRule:
    """The rule that a configuration describes."""
    return StepRule(
        discount=discount,
        episodes=config.episodes,
        baseline=config.baseline,
        ridge=config.ridge,
        gae_lambda=config.gae_lambda,
        variance_prior=config.variance_prior,
        noise_episodes=config.noise_episodes,
        exploration=config.exploration,
    )


@dataclass(frozen=True, eq=False)
class OuterGradient:
    """Means over the tasks of a batch.

    Attributes:
        theta: float [P], gradient of what the adapted policies are worth, in theta.
        sizes: float [2 L], likewise, in the log alpha of each weight and bias.
        entropy: float [P], gradient of the meta policy's entropy over the steps of its episodes.
    """

    theta: Array
    sizes: Array
    entropy: Array


@dataclass(frozen=True, eq=False)
class Objective:
    """What adapted policies are worth, as a function of theta.

    Attributes:
        problems: the same for every range of tasks.
        threads: that the ranges may be shared among.
    """

    problems: tuple[core.Problem, ...]
    threads: int

    @property
    def num_tasks(self) -> int:
        """N."""
        return sum(len(problem.tasks.live) for problem in self.problems)

    def draw_and_differentiate(
        self, theta: Array, config: TrainingConfig, horizon: int, generator: torch.Generator
    ) -> tuple[OuterGradient, list[core.Drawn], core.Seen]:
        """Adapt to every task by inner steps, and differentiate what that is worth (Finn et al. 2017).

        Args:
            theta: float [P], the meta policy.
            config: inner steps and episodes.
            horizon: of the episodes.
            generator: of the episodes.

        Returns:
            The gradient, what was drawn for each range, and what was seen of each task.
        """
        rounds = config.inner_steps + (config.estimator == "sampled")
        shape = (self.num_tasks, rounds, config.episodes, horizon + 1)
        dtype = torch.float64 if theta.itemsize == 8 else torch.float32
        draws = torch.rand(shape, generator=generator, dtype=dtype).numpy()
        ends = accumulate((len(problem.tasks.live) for problem in self.problems), initial=0)
        found = on_threads(
            [
                partial(core.draw_and_differentiate, problem, theta, draws[slice(*bounds)])
                for problem, bounds in zip(self.problems, pairwise(ends), strict=True)
            ],
            self.threads,
        )
        gradients, drawn, seen = zip(*found, strict=True)
        whole = core.Seen(*(np.concatenate(parts) for parts in zip(*seen, strict=True)))
        return self._mean(gradients), list(drawn), whole

    def differentiate_again(self, theta: Array, drawn: Sequence[core.Drawn]) -> OuterGradient:
        """The gradient at other parameters with what was drawn before; the entropy's is 0."""
        pairs = zip(self.problems, drawn, strict=True)
        return self._mean(
            on_threads(
                [partial(core.differentiate_again, problem, theta, mine) for problem, mine in pairs],
                self.threads,
            )
        )

    def on_counting_states(
        self, drawn: Sequence[core.Drawn]
    ) -> tuple[Objective, Sequence[core.Drawn], Numbers]:
        """The objective by episodes where they have been, what was drawn there, and its entries of theta.

        Elsewhere there is neither gradient nor divergence. Exact returns depend on every state.
        """
        network = self.problems[0].network
        if self.problems[0].exact:
            return self, drawn, np.arange(network.bounds[-1][2])
        states = np.unique(np.concatenate([counting_states(mine) for mine in drawn]))
        entries = counting_entries(network, states)
        pairs = [
            restricted(problem, mine, states, entries)
            for problem, mine in zip(self.problems, drawn, strict=True)
        ]
        problems, known = zip(*pairs, strict=True)
        return Objective(problems, self.threads), known, entries

    def judge(self, theta: Array, drawn: Sequence[core.Drawn]) -> tuple[float, float]:
        """What the policies adapted from theta are worth, and their divergence from those drawn, in nats."""
        pairs = zip(self.problems, drawn, strict=True)
        pieces = [partial(core.judge, problem, theta, mine) for problem, mine in pairs]
        found = on_threads(pieces, self.threads)
        worth, divergence = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return float(worth.mean()), float(divergence.mean())

    def curvature(self, theta: Array, drawn: Sequence[core.Drawn]) -> Callable[[Array], Array]:
        """The Hessian of the divergence at theta, as a function of the direction [P] it is applied to."""
        triples = [
            (problem, core.adapt_again(problem, theta, mine.losses), mine.visits)
            for problem, mine in zip(self.problems, drawn, strict=True)
        ]

        def product(direction: Array) -> Array:
            pieces = [partial(core.fisher_product, *triple, direction) for triple in triples]
            parts = on_threads(pieces, self.threads)
            total: Array = np.sum(parts, axis=0) / self.num_tasks
            return total

        return product

    def _mean(self, parts: Sequence[core.Gradient]) -> OuterGradient:
        theta, sizes, entropy = (reduce(np.add, arrays) for arrays in zip(*parts, strict=True))
        of_sizes = per_parameter(sizes, self.problems[0].network)
        return OuterGradient(theta / self.num_tasks, of_sizes / self.num_tasks, entropy / self.num_tasks)


def ranges(tasks: Tasks, network: Network) -> tuple[Tasks, ...]:
    """Tasks in ranges of nearly equal length."""
    num_tasks, num_states, _ = tasks.enabled.shape
    size = max(1, min(_RANGE, _RANGE_NUMEL // (num_states * max(network.sizes[1:]))))
    count = -(-num_tasks // size)
    ends = [num_tasks * part // count for part in range(count + 1)]
    return tuple(tasks.some(slice(*bounds)) for bounds in pairwise(ends))


def outer_objective(
    parts: Sequence[Tasks],
    network: Network,
    step_sizes: Array,
    rule: StepRule,
    variance: Tensor | None,
    config: TrainingConfig,
    horizon: int,
    threads: int,
) -> Objective:
    """The objective on tasks.

    Args:
        parts: N of them, in ranges.
        network: the policies' shape.
        step_sizes: float [2 L], alpha for each weight and bias.
        rule: how episodes become a step.
        variance: float [], of the advantages so far; None at the first update.
        config: estimator, inner steps, order, span.
        horizon: T.
        threads: that the work may be shared among.
    """
    first = core.Problem(
        tasks=parts[0],
        network=network,
        step_sizes=per_entry(step_sizes, network),
        judgement=rule.judgement(variance),
        horizon=horizon if config.span == "horizon" else 0,
        order=config.order,
        exact=config.estimator == "exact",
        noise=config.sampling_noise,
    )
    return Objective(tuple(first._replace(tasks=part) for part in parts), threads)
