"""The outer objective of MAML: drawn, differentiated, and its Fisher products; sums over N tasks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from merap.learning.core.episodes import Episodes, mean_return, rollout, visits
from merap.learning.core.jit import Array
from merap.learning.core.network import Network, pullback, pushforward
from merap.learning.core.softmax import divergence, entropy_slope, sampling_noise, through_softmax
from merap.learning.core.steps import (
    Loss,
    Policies,
    Step,
    policies,
    pull,
    push,
    step_again,
    step_from,
    stepped,
)
from merap.learning.core.surrogate import Judgement, Surrogate, surrogate
from merap.learning.core.task import Tasks
from merap.learning.core.values import values


class Problem(NamedTuple):
    """What the outer objective is.

    Attributes:
        tasks: N of them.
        network: the policies' shape.
        step_sizes: float [P], alpha of each entry of theta.
        judgement: how advantages are made.
        horizon: T of exact returns; 0: infinite.
        order: 2 differentiates through the inner steps; 1 takes them as constants.
        exact: adapted policies are judged by their exact return, and inner losses know it.
        noise: inner steps of `exact` carry the sampling noise of their episodes.
    """

    tasks: Tasks
    network: Network
    step_sizes: Array
    judgement: Judgement
    horizon: int
    order: int
    exact: bool
    noise: bool


class Drawn(NamedTuple):
    """What was sampled.

    Attributes:
        losses: of the J inner steps.
        old: float [N, S, A], the adapted policies.
        worth: float [N, S, A], what each unit of pi(a | s) is worth by their episodes; None: they are
            judged by their exact return.
        visits: float [N, S], share of their steps that begin in a state.
    """

    losses: tuple[Loss, ...]
    old: Array
    worth: Array | None
    visits: Array


class Seen(NamedTuple):
    """What was seen of each task, [N].

    Attributes:
        meta_return: discounted return of the meta policy.
        adapted_return: that of the adapted policies.
        variance: of the advantages, mean over the inner steps.
        entropy: of the meta policy over the steps of its episodes, in nats.
    """

    meta_return: Array
    adapted_return: Array
    variance: Array
    entropy: Array


class Gradient(NamedTuple):
    """Sums over the tasks, [P].

    Attributes:
        theta: of what the adapted policies are worth, in theta.
        sizes: likewise, in the log alpha of each entry.
        entropy: of the meta policy's entropy, in theta.
    """

    theta: Array
    sizes: Array
    entropy: Array


class Adapted(NamedTuple):
    """Policies that theta was adapted to.

    Attributes:
        steps: the inner steps.
        after: where they lead.
    """

    steps: tuple[Step, ...]
    after: Policies


def draw_and_differentiate(problem: Problem, theta: Array, draws: Array) -> tuple[Gradient, Drawn, Seen]:
    """Adapt with episodes that draws lead to, and differentiate what that is worth.

    Lines 5 to 10 of the paper's Algorithm 1.

    Args:
        problem: the objective.
        theta: float [P].
        draws: float [N, J, B, T + 1], of the inner steps; with one more after the J-th for the
            episodes of the adapted policies, if those are judged by them.
    """
    network, tasks = problem.network, problem.tasks
    now = policies(theta, network, tasks)
    steps: list[Step] = []
    returns, variances, shares = [], [], []
    for j in range(draws.shape[1] - (not problem.exact)):
        step, mean, variance, share = _drawn_step(problem, now, draws[:, j])
        steps.append(step)
        returns.append(mean)
        variances.append(variance)
        shares.append(share)
        now = policies(stepped(step, problem.step_sizes), network, tasks)
    adapted = Adapted(tuple(steps), now)
    drawn, slope, adapted_return = _drawn_outer(problem, adapted, draws[:, -1])
    entropy, entropy_in_logits = entropy_slope(steps[0].before.table, shares[0])
    of_entropy, _ = pullback(theta, network, steps[0].before.at, entropy_in_logits)
    gradient = Gradient(*_through_steps(problem, adapted, slope), of_entropy[0])
    return (
        gradient,
        drawn,
        Seen(returns[0], adapted_return, reduce(np.add, variances) / len(variances), entropy),
    )


def adapt_again(problem: Problem, theta: Array, losses: Sequence[Loss]) -> Adapted:
    """Inner steps from theta down losses that were drawn before."""
    steps = []
    now = policies(theta, problem.network, problem.tasks)
    for loss in losses:
        steps.append(step_again(now, loss, problem.network, problem.tasks, problem.horizon))
        now = policies(stepped(steps[-1], problem.step_sizes), problem.network, problem.tasks)
    return Adapted(tuple(steps), now)


def differentiate_again(problem: Problem, theta: Array, drawn: Drawn) -> Gradient:
    """The gradient at other parameters with what was drawn before; without the entropy's, which is 0."""
    adapted = adapt_again(problem, theta, drawn.losses)
    table = adapted.after.table
    worth = drawn.worth
    if worth is None:
        worth = values(table, problem.tasks, problem.horizon).gradient
    return Gradient(*_through_steps(problem, adapted, through_softmax(table, worth)), np.zeros_like(theta))


def judge(problem: Problem, theta: Array, drawn: Drawn) -> tuple[Array, Array]:
    """What the policies adapted from theta are worth, and their divergence from the old in nats, [N].

    By episodes the worth is the surrogate of Schulman et al. (2015, eq. 14).
    """
    table = adapt_again(problem, theta, drawn.losses).after.table
    if drawn.worth is None:
        worth = values(table, problem.tasks, problem.horizon).total
    else:
        worth = np.einsum("nsa,nsa->n", drawn.worth, table)
    return worth, divergence(drawn.old, table, drawn.visits)


def fisher_product(problem: Problem, adapted: Adapted, visits: Array, direction: Array) -> Array:
    """The Hessian of the mean divergence from policies times a direction [P], at these policies; [P].

    It is J' diag(F) J with the Jacobian J of the adapted logits in theta and the Fisher matrices F of
    the action distributions, weighted by visits [N, S].
    """
    network, tasks, after = problem.network, problem.tasks, adapted.after
    tangent = direction[np.newaxis]
    if problem.order == 2:
        tangent = push(adapted.steps, tangent, problem.step_sizes, network, tasks)
    logits_dot = pushforward(after.theta, network, after.at, tangent).logits
    slope = visits[..., np.newaxis] * through_softmax(after.table, logits_dot)
    return _through_steps(problem, adapted, slope)[0]


def _sampled(problem: Problem, table: Array, draws: Array) -> tuple[Episodes, Surrogate]:
    """The episodes that draws [N, B, T + 1] lead to, and their loss."""
    episodes = rollout(table, problem.tasks, draws)
    return episodes, surrogate(episodes, None, problem.judgement, table.shape)


def _drawn_step(problem: Problem, now: Policies, draws: Array) -> tuple[Step, Array, Array, Array]:
    """A step, and what its episodes show: mean return [N], the advantages' variance [N], visits [N, S]."""
    table, tasks = now.table, problem.tasks
    episodes, sampled = _sampled(problem, table, draws)
    if not problem.exact:
        step = step_from(now, Loss(sampled.gradient, None), None, problem.network)
        mean = mean_return(episodes, problem.judgement.discount)
        return step, mean, sampled.variance, visits(episodes, table.shape[1])
    found = values(table, tasks, problem.horizon)
    scale = sampled.scale.astype(table.dtype)
    noise = np.zeros_like(table)
    if problem.noise:  # what was sampled, without its expectation
        noise = sampling_noise(table, sampled.gradient, scale, found.gradient)
    step = step_from(now, Loss(noise, scale), found, problem.network)
    return step, found.total, sampled.variance, visits(episodes, table.shape[1])


def _drawn_outer(problem: Problem, adapted: Adapted, draws: Array) -> tuple[Drawn, Array, Array]:
    """What adapted policies are judged by, its slope in their logits [N, S, A], and their return [N]."""
    table, tasks = adapted.after.table, problem.tasks
    losses = tuple(step.loss for step in adapted.steps)
    if problem.exact:
        found = values(table, tasks, problem.horizon)
        drawn = Drawn(losses, table, None, found.visits / found.visits.sum(axis=1, keepdims=True))
        return drawn, through_softmax(table, found.gradient), found.total
    episodes, sampled = _sampled(problem, table, draws)
    worth = np.divide(-sampled.gradient, table, out=np.zeros_like(table), where=sampled.gradient != 0)
    drawn = Drawn(losses, table, worth, visits(episodes, table.shape[1]))
    return drawn, through_softmax(table, worth), mean_return(episodes, problem.judgement.discount)


def _through_steps(problem: Problem, adapted: Adapted, slope: Array) -> tuple[Array, Array]:
    """A slope in the adapted policies' logits [N, S, A] as one in theta [P] and log alpha [P]."""
    network, after = problem.network, adapted.after
    cotangent, _ = pullback(after.theta, network, after.at, slope)
    return pull(adapted.steps, cotangent, problem.step_sizes, network, problem.tasks, problem.order)
