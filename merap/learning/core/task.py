"""Tasks as the core reads them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from merap.learning.core.jit import Array, Bools, Numbers, Successors, Times


class Tasks(NamedTuple):
    """N tasks side by side; floats are all of one precision.

    Attributes:
        enabled: bool [N, S, A].
        live: bool [N, S], some action is enabled.
        successor: uint32 [N, S, A, K], index into S.
        prob: float [N, S, A, K].
        reward: float [N, S, A, K].
        initial: float [N, S].
        weight: float [N, S, A, K], discounted probability to go on in a successor.
        expected: float [N, S, A], expected reward.
        earliest: int32 [N, S], the first time at which an episode can be in a state.
    """

    enabled: Bools
    live: Bools
    successor: Successors
    prob: Array
    reward: Array
    initial: Array
    weight: Array
    expected: Array
    earliest: Times

    @property
    def target(self) -> Successors:
        """uint32 [N, S, M], the successors of all M = A K branches of a state."""
        return self.successor.reshape(*self.live.shape, -1)

    def chain(self, policy: Array) -> Array:
        """float [N, S, M], discounted probability to go on along a branch; linear in a policy [N, S, A]."""
        chain: Array = policy[..., np.newaxis] * self.weight
        return chain.reshape(*self.live.shape, -1)

    def at_targets(self, of_states: Array) -> Array:
        """float [N, S, M] of float [N, S]."""
        return of_states[np.arange(len(of_states))[:, np.newaxis, np.newaxis], self.target]

    def some(self, index: slice | Numbers) -> Tasks:
        """Some of the tasks."""
        return Tasks(**{name: array[index] for name, array in self._asdict().items()})


def earliest_times(initial: Array, weight: Array, successor: Successors, horizon: int) -> Times:
    """int32 [N, S]: how many steps it takes to get to a state at least; T if they are not enough."""
    earliest = np.full(initial.shape, horizon, dtype=np.int32)
    earliest[initial > 0] = 0
    number = np.broadcast_to(np.arange(len(initial))[:, np.newaxis, np.newaxis, np.newaxis], weight.shape)
    for time in range(horizon - 1):
        leaving = (earliest == time)[..., np.newaxis, np.newaxis] & (weight > 0)
        if not leaving.any():
            break
        entered = (number[leaving], successor[leaving])
        earliest[entered] = np.minimum(earliest[entered], time + 1)
    return earliest
