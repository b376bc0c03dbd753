"""A problem on the states that count: where nobody was, a policy has no gradient and no divergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.learning.core.jit import Array, Numbers
from merap.learning.core.meta import Drawn, Problem
from merap.learning.core.network import Network
from merap.learning.core.steps import Loss


def counting_states(drawn: Drawn) -> Numbers:
    """int64, the states in which some task's losses or visits are not 0."""
    counts = drawn.visits > 0
    for loss in drawn.losses:
        counts = counts | (loss.weight != 0).any(axis=-1)
    return np.flatnonzero(counts.any(axis=0))


def counting_entries(network: Network, states: Numbers) -> Numbers:
    """int64, the entries of theta that act on these states: of a one-hot observation, their rows."""
    _, _, end = network.bounds[-1]
    if network.features is not None:
        return np.arange(end)
    rows = states[:, np.newaxis] * network.sizes[1] + np.arange(network.sizes[1])
    return np.concatenate([rows.ravel(), np.arange(network.bounds[0][1], end)])


def restricted(problem: Problem, drawn: Drawn, states: Numbers, entries: Numbers) -> tuple[Problem, Drawn]:
    """The same objective by episodes, on these states and entries alone.

    It knows no exact returns, which may depend on every state.
    """
    assert not problem.exact, "exact returns depend on every state"
    network = problem.network
    if network.features is None:
        fewer = replace(network, sizes=(len(states), *network.sizes[1:]))
    else:
        fewer = replace(network, features=network.features[states])
    tasks = problem.tasks._replace(
        enabled=problem.tasks.enabled[:, states], live=problem.tasks.live[:, states]
    )
    losses = tuple(Loss(_rows(loss.weight, states), None) for loss in drawn.losses)
    worth = None if drawn.worth is None else _rows(drawn.worth, states)
    return (
        problem._replace(network=fewer, tasks=tasks, step_sizes=problem.step_sizes[entries]),
        Drawn(losses, _rows(drawn.old, states), worth, _rows(drawn.visits, states)),
    )


def _rows(table: Array, states: Numbers) -> Array:
    """[N, states, ..], contiguous."""
    return np.ascontiguousarray(table[:, states])
