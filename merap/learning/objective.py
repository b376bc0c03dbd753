"""The outer objective of MAML on a batch of tasks (`eq:mrl2`, `eq:meta-opt`).

An update draws episodes first; with what was drawn held, the objective is a smooth function of theta, which
is differentiated, judged at other parameters, and whose curvature a trust region needs.

A batch is worked on in ranges of tasks, which threads may share. The ranges depend on sizes alone, and their
results are added up in order: what is learned does not depend on the number of threads.

Axes: N tasks, S states, A actions, J inner steps, P parameters in one row, L layers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import accumulate, pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.drawing import Drawn, Sampling, Seen
from merap.learning.gradient_step import pullback
from merap.learning.inner_loop import InnerLoop, given, through_softmax
from merap.learning.policy import Parameters, PolicyNetwork, action_logits, shaped, softmax
from merap.learning.surrogate import AdvantageRule
from merap.learning.tasks import TaskBatch
from merap.learning.threads import on_threads

# Hidden units of a range, in all states of its tasks: what fits into caches, or one task.
_RANGE_NUMEL = 2**20
# A probability that has been rounded to 0 counts as this much.
_LEAST = 1e-37


class OuterGradient(NamedTuple):
    """Means over the tasks of a batch.

    Attributes:
        theta: float [P], gradient of what the adapted policies are worth, in theta.
        sizes: float [2 L], likewise, in the log alpha of each weight and bias.
    """

    theta: Tensor
    sizes: Tensor


@dataclass(frozen=True, eq=False)
class OuterObjective:
    """What adapted policies are worth, as a function of theta [P] and log alpha [2 L].

    Attributes:
        loops: adaptation to each range of tasks.
        network: the policies' shape.
        entries: int64 [P'], those of theta that count; None: all. The loops know no others.
        threads: that the ranges may be shared among.
    """

    loops: tuple[InnerLoop, ...]
    network: PolicyNetwork
    entries: Tensor | None
    threads: int

    @property
    def num_tasks(self) -> int:
        """N."""
        return sum(loop.num_tasks for loop in self.loops)

    def draw(
        self,
        theta: Tensor,
        log_sizes: Tensor,
        rule: AdvantageRule,
        config: TrainingConfig,
        generator: torch.Generator,
    ) -> tuple[list[Drawn], Seen, OuterGradient | None]:
        """Sample the episodes of inner steps, and of adapted policies if they are judged by them.

        Lines 5 to 9 of the paper's Algorithm 1.

        Args:
            theta: float [P], the meta policy.
            log_sizes: float [2 L].
            rule: how advantages are made.
            config: inner steps and episodes.
            generator: of the episodes.

        Returns:
            What was drawn for each range, what was seen of each task, and the gradient where it is not made
            of episodes: then it is found on the way.
        """
        rounds = config.inner_steps + (config.estimator == "sampled")
        longest = max(loop.known.longest_horizon for loop in self.loops)
        shape = (self.num_tasks, rounds, config.episodes, longest + 1)
        draws = torch.rand(shape, generator=generator, dtype=theta.dtype)
        work = self._draw_and_differentiate if config.estimator == "exact" else self._draw
        ends = accumulate((loop.num_tasks for loop in self.loops), initial=0)
        pieces = [
            partial(work, Sampling(loop, rule, config), loop, theta, log_sizes, draws[slice(*bounds)])
            for loop, bounds in zip(self.loops, pairwise(ends), strict=True)
        ]
        drawn, seen, sums = zip(*on_threads(pieces, self.threads), strict=True)
        gradient = None if sums[0] is None else self._mean(sums)
        return list(drawn), Seen(*map(torch.cat, zip(*seen, strict=True))), gradient

    def gradient(self, theta: Tensor, log_sizes: Tensor, drawn: Sequence[Drawn]) -> OuterGradient:
        """Differentiate what the adapted policies are worth, with what was drawn held (Finn et al. 2017).

        Args:
            theta: float [P], at which.
            log_sizes: float [2 L], likewise.
            drawn: for each range.
        """
        pieces = [
            partial(self._gradient, loop, theta, log_sizes, mine)
            for loop, mine in zip(self.loops, drawn, strict=True)
        ]
        return self._mean(on_threads(pieces, self.threads))

    def entropy_gradient(self, theta: Tensor, drawn: Sequence[Drawn]) -> Tensor:
        """float [P], the gradient of the meta policy's entropy over the steps of its episodes."""
        network = self.loops[0].network
        slope = reduce(torch.add, (mine.entropy_slope for mine in drawn)) / self.num_tasks
        leaf = theta.detach().requires_grad_()
        with torch.enable_grad():
            logits = action_logits(network, shaped(leaf, network))
            (gradient,) = pullback(logits, slope, (leaf,), graph=False)
        return gradient

    def judge(self, theta: Tensor, log_sizes: Tensor, drawn: Sequence[Drawn]) -> tuple[float, float]:
        """What the policies adapted from theta are worth, and their divergence from the old in nats.

        By episodes the worth is the surrogate of Schulman et al. (2015, eq. 14).
        """
        pieces = [
            partial(_judge, loop, theta, log_sizes, mine)
            for loop, mine in zip(self.loops, drawn, strict=True)
        ]
        found = zip(*on_threads(pieces, self.threads), strict=True)
        worth, divergence = (torch.cat(parts).mean().item() for parts in found)
        return worth, divergence

    def curvature(
        self, theta: Tensor, log_sizes: Tensor, drawn: Sequence[Drawn]
    ) -> Callable[[Tensor], Tensor]:
        """The Hessian of the divergence at theta, as a function of the direction [P] it is applied to."""
        pairs = zip(self.loops, drawn, strict=True)
        products = [_fisher(loop, theta, log_sizes, mine) for loop, mine in pairs]

        def product(direction: Tensor) -> Tensor:
            parts = on_threads([partial(part, direction) for part in products], self.threads)
            return reduce(torch.add, parts) / self.num_tasks

        return product

    def on_counting_states(self, drawn: Sequence[Drawn]) -> tuple[OuterObjective, Sequence[Drawn]]:
        """The objective by episodes where they have been, and what was drawn there.

        Elsewhere there is neither gradient nor divergence. Exact returns depend on every state.
        """
        if drawn[0].worth is None:
            return self, drawn
        states = torch.stack([mine.counting_states for mine in drawn]).any(dim=0).nonzero().squeeze(1)
        network = self.network
        if network.features is None:
            width = network.layer_sizes[1]
            rows = (states[:, None] * width + torch.arange(width)).flatten()
            rest = torch.arange(network.parameter_sizes[0], sum(network.parameter_sizes))
            entries, fewer = torch.cat([rows, rest]), replace(network, num_states=len(states))
        else:
            entries = None
            fewer = replace(network, num_states=len(states), features=network.features[states])
        loops = tuple(
            replace(loop, network=fewer, enabled=loop.enabled[:, states], tasks=None) for loop in self.loops
        )
        return replace(self, loops=loops, entries=entries), [mine.at(states) for mine in drawn]

    def counting(self, theta: Tensor) -> Tensor:
        """float [P'], the entries of a row [P] that count."""
        return theta if self.entries is None else theta[self.entries]

    def spread(self, part: Tensor, like: Tensor) -> Tensor:
        """float [P], entries that count [P'] in the place of those of another row."""
        return part if self.entries is None else like.index_copy(0, self.entries, part)

    def _mean(self, sums: Sequence[tuple[Tensor, ...]]) -> OuterGradient:
        return OuterGradient(
            *(reduce(torch.add, parts) / self.num_tasks for parts in zip(*sums, strict=True))
        )

    def _gradient(
        self, loop: InnerLoop, theta: Tensor, log_sizes: Tensor, drawn: Drawn
    ) -> tuple[Tensor, ...]:
        """Sums over a range: the gradients in theta and log alpha."""
        with torch.enable_grad():
            leaves = _leaves(theta, log_sizes)
            adapted = loop.adapt(*_start(loop, *leaves), given(drawn.losses), graph=True)
            return torch.autograd.grad(_worth(loop, loop.policy(adapted), drawn).sum(), leaves)

    def _draw(
        self, sampling: Sampling, loop: InnerLoop, theta: Tensor, log_sizes: Tensor, draws: Tensor
    ) -> tuple[Drawn, Seen, None]:
        """What draws [N, J + 1, B, T + 1] lead to on a range."""
        adapted = sampling.adapted(*_start(loop, theta, log_sizes), draws[:, :-1])
        return *sampling.judged_by_episodes(adapted, draws[:, -1]), None

    def _draw_and_differentiate(
        self, sampling: Sampling, loop: InnerLoop, theta: Tensor, log_sizes: Tensor, draws: Tensor
    ) -> tuple[Drawn, Seen, tuple[Tensor, ...]]:
        """What draws [N, J, B, T + 1] lead to on a range, and sums of its gradients."""
        with torch.enable_grad():
            leaves = _leaves(theta, log_sizes)
            policy = loop.policy(sampling.adapted(*_start(loop, *leaves), draws))
            returns = loop.returns(policy)
            gradients = torch.autograd.grad(returns.sum(), leaves)
        return *sampling.judged_exactly(policy, returns), gradients


def _start(loop: InnerLoop, theta: Tensor, log_sizes: Tensor) -> tuple[Parameters, Sequence[Tensor]]:
    """Parameters under their names, and alpha of each."""
    return shaped(theta, loop.network), log_sizes.exp().unbind()


def _leaves(*rows: Tensor) -> tuple[Tensor, ...]:
    return tuple(row.detach().requires_grad_() for row in rows)


def _worth(loop: InnerLoop, policy: Tensor, drawn: Drawn) -> Tensor:
    """float [N], of adapted policies [N, S, A]."""
    return loop.returns(policy) if drawn.worth is None else (drawn.worth * policy).sum(dim=(1, 2))


@torch.no_grad()
def _judge(loop: InnerLoop, theta: Tensor, log_sizes: Tensor, drawn: Drawn) -> tuple[Tensor, Tensor]:
    """Worth and divergence of a range's tasks, float [N]."""
    policy = loop.policy(loop.adapt(*_start(loop, theta, log_sizes), given(drawn.losses)))
    worth = _worth(loop, policy, drawn)
    if drawn.old is None or drawn.visits is None:
        return worth, torch.full_like(worth, torch.nan)
    surprise = drawn.old * (drawn.old.clamp_min(_LEAST).log() - policy.clamp_min(_LEAST).log())
    return worth, (drawn.visits * surprise.sum(dim=-1)).sum(dim=-1)


def _fisher(loop: InnerLoop, theta: Tensor, log_sizes: Tensor, drawn: Drawn) -> Callable[[Tensor], Tensor]:
    """A range's sum of the divergences' Hessian, as a function of the direction [P] it is applied to.

    It is J' F J with the Jacobian J of the adapted logits in theta and the Fisher matrices F of the action
    distributions, weighted by visits. J' u is one backward pass with a graph; it is linear in u, so that a
    backward pass through it gives J v.
    """
    assert drawn.visits is not None, "nothing was drawn of the adapted policies"
    visits, leaf = drawn.visits.unsqueeze(-1), theta.detach().requires_grad_()
    with torch.enable_grad():
        adapted = loop.adapt(*_start(loop, leaf, log_sizes), given(drawn.losses), graph=True)
        logits = action_logits(loop.network, adapted)
        weight = torch.zeros_like(logits).requires_grad_()
        (back,) = torch.autograd.grad(logits, leaf, weight, create_graph=True)
    policy = softmax(logits.detach() + loop.mask)

    def product(direction: Tensor) -> Tensor:
        (along,) = torch.autograd.grad(back, weight, direction, retain_graph=True)
        slope = visits * through_softmax(policy, along)
        (result,) = torch.autograd.grad(logits, leaf, slope, retain_graph=True)
        return result

    return product


def outer_objective(
    tasks: TaskBatch, network: PolicyNetwork, config: TrainingConfig, threads: int
) -> OuterObjective:
    """The objective on tasks, in ranges of nearly equal length.

    Args:
        tasks: N of them.
        network: the policies' shape.
        config: estimator, order, span.
        threads: that the work may be shared among.
    """
    size = max(1, _RANGE_NUMEL // (tasks.num_states * max(network.layer_sizes[1:])))
    count = -(-tasks.num_tasks // size)
    ends = [tasks.num_tasks * part // count for part in range(count + 1)]
    parts = [tasks] if count == 1 else [tasks[slice(*bounds)] for bounds in pairwise(ends)]
    loops = (InnerLoop(network, part.enabled, part, config.span, config.order) for part in parts)
    return OuterObjective(tuple(loops), network, None, threads)
