"""What an outer update samples: the episodes of inner steps, and those of the adapted policies.

Axes: N tasks, S states, A actions, J inner steps, B episodes, T steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.episodes import drawn_episodes
from merap.learning.exact import Evaluation, evaluate
from merap.learning.inner_loop import InnerLoop, Loss, exact_loss
from merap.learning.policy import Parameters
from merap.learning.surrogate import AdvantageRule, surrogate


class Drawn(NamedTuple):
    """What was sampled of a range of tasks.

    Attributes:
        losses: of the J inner steps.
        entropy_slope: float [S, A], gradient of the meta policy's entropy over the steps of its episodes,
            summed over the tasks, in the logits, which they share.
        old: float [N, S, A], the adapted policies; None where nothing asks for them.
        visits: float [N, S], share of their steps that begin in a state; None likewise.
        worth: float [N, S, A], of each unit of their pi(a | s), by their episodes; None: they are
            judged by their exact return.
    """

    losses: tuple[Loss, ...]
    entropy_slope: Tensor
    old: Tensor | None
    visits: Tensor | None
    worth: Tensor | None

    @property
    def counting_states(self) -> Tensor:
        """bool [S], the states in which some task's losses or visits are not 0."""
        counts = (self.entropy_slope != 0).any(dim=-1)
        for loss in self.losses:
            counts |= (loss.weight != 0).any(dim=-1).any(dim=0)
        return counts if self.visits is None else counts | (self.visits > 0).any(dim=0)

    def at(self, states: Tensor) -> Drawn:
        """The same at some states."""
        losses = tuple(loss._replace(weight=loss.weight[:, states]) for loss in self.losses)
        parts = (part if part is None else part[:, states] for part in (self.old, self.visits, self.worth))
        return Drawn(losses, self.entropy_slope[states], *parts)


class Seen(NamedTuple):
    """What was seen of each task, float [N].

    Attributes:
        meta_return: discounted return of the meta policy.
        adapted_return: of the adapted policies.
        variance: of the advantages, mean over the inner steps.
        entropy: of the meta policy over the steps of its episodes, in nats.
    """

    meta_return: Tensor
    adapted_return: Tensor
    variance: Tensor
    entropy: Tensor


class Sampling:
    """Episodes of the inner steps of a range of tasks, and what they show.

    Args:
        loop: adaptation to the N tasks.
        rule: how advantages are made.
        config: estimator and outer optimiser.
    """

    def __init__(self, loop: InnerLoop, rule: AdvantageRule, config: TrainingConfig) -> None:
        self._loop, self._rule, self._config = loop, rule, config
        self._losses: list[Loss] = []
        self._returns: list[Tensor] = []
        self._variances: list[Tensor] = []
        self._entropy = self._entropy_slope = torch.zeros(())

    def adapted(self, theta: Parameters, step_sizes: Sequence[Tensor], draws: Tensor) -> Parameters:
        """Adapt by the episodes that draws lead to.

        Args:
            theta: the meta policy's parameters.
            step_sizes: alpha, float [] for each of them.
            draws: float [N, J, B, T + 1].

        Returns:
            Parameters [N, ...]; if returns are exact with a graph.
        """
        losses = [partial(self._loss, row) for row in draws.unbind(dim=1)]
        return self._loop.adapt(theta, step_sizes, losses, graph=self._config.estimator == "exact")

    @torch.no_grad()
    def _loss(self, draws: Tensor, policy: Tensor) -> tuple[Loss, Evaluation | None]:
        """The loss of policies [N, S, A] by the episodes that draws [N, B, T + 1] lead to."""
        episodes = drawn_episodes(policy, self._loop.known, draws)
        found = surrogate(episodes, self._rule, policy.shape)
        if not self._losses:
            self._entropy, self._entropy_slope = _entropy(policy, episodes.visits(policy.shape[1]))
        known = None
        if self._config.estimator == "exact":
            known = evaluate(policy, self._loop.known, self._loop.span)
            loss = exact_loss(policy, found, known, noise=self._config.sampling_noise)
        else:
            loss = Loss(found.gradient, None)
        self._losses.append(loss)
        self._returns.append(known.total if known else episodes.mean_return(self._rule.discount))
        self._variances.append(found.variance)
        return loss, known

    @torch.no_grad()
    def judged_by_episodes(self, adapted: Parameters, draws: Tensor) -> tuple[Drawn, Seen]:
        """Sample with the adapted policies of parameters [N, ...], by draws [N, B, T + 1]."""
        policy = self._loop.policy(adapted)
        episodes = drawn_episodes(policy, self._loop.known, draws)
        gradient = surrogate(episodes, self._rule, policy.shape).gradient
        worth = torch.where(gradient != 0, -gradient / policy, 0.0)
        return (
            Drawn(tuple(self._losses), self._entropy_slope, policy, episodes.visits(policy.shape[1]), worth),
            self._seen(episodes.mean_return(self._rule.discount)),
        )

    @torch.no_grad()
    def judged_exactly(self, policy: Tensor, returns: Tensor) -> tuple[Drawn, Seen]:
        """Take in the adapted policies [N, S, A] and their returns [N]."""
        old = visits = None
        if self._config.outer == "trpo":
            old, visits = policy.detach(), evaluate(policy, self._loop.known, self._loop.span).visits
            visits = visits / visits.sum(dim=1, keepdim=True)
        return Drawn(tuple(self._losses), self._entropy_slope, old, visits, None), self._seen(returns)

    def _seen(self, adapted_return: Tensor) -> Seen:
        variance = torch.stack(self._variances).mean(dim=0)
        return Seen(self._returns[0], adapted_return.detach(), variance, self._entropy)


def _entropy(policy: Tensor, visits: Tensor) -> tuple[Tensor, Tensor]:
    """Entropy in nats weighted by visits [N, S], float [N]; its gradient in shared logits [S, A]."""
    surprise = -torch.xlogy(policy, policy)
    entropy = surprise.sum(dim=-1)
    slope = visits.unsqueeze(-1) * (surprise - policy * entropy.unsqueeze(-1))
    return (visits * entropy).sum(dim=-1), slope.sum(dim=0)
