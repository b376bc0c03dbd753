"""Task batches and policies as the compiled core reads them.

Axes: N tasks, S states, A actions, P parameters in one row, L layers.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from merap.learning.core.jit import Array
from merap.learning.core.network import Network
from merap.learning.core.task import Tasks, earliest_times
from merap.learning.policy import Parameters, PolicyNetwork
from merap.learning.tasks import TaskBatch


def core_tasks(tasks: TaskBatch, discount: float) -> Tasks:
    """A task batch for values with that discount."""
    weight = (discount * tasks.survival).numpy()
    initial = tasks.initial.numpy()
    successor = tasks.next_state.numpy().astype(np.uint32)
    return Tasks(
        enabled=tasks.enabled.numpy(),
        live=tasks.enabled.any(dim=-1).numpy(),
        successor=successor,
        prob=tasks.prob.numpy(),
        reward=tasks.reward.numpy(),
        initial=initial,
        weight=weight,
        expected=tasks.expected_reward.numpy(),
        earliest=earliest_times(initial, weight, successor, tasks.horizon),
    )


def core_network(network: PolicyNetwork, dtype: torch.dtype) -> Network:
    """The shape of a policy."""
    features = None if network.features is None else array_of(network.features.to(dtype))
    return Network(network.layer_sizes, features, network.activation)


def per_entry(sizes: Array, network: Network) -> Array:
    """One number for each weight and bias [2 L] as one for each of their entries [P]."""
    return np.repeat(sizes, _entries(network))


def per_parameter(entries: Array, network: Network) -> Array:
    """Sums over the entries [P] of each weight and bias, [2 L]."""
    starts = np.cumsum([0, *_entries(network)[:-1]])
    sums: Array = np.add.reduceat(entries, starts)
    return sums


def _entries(network: Network) -> list[int]:
    """How many entries each weight and bias has."""
    return [part for start, middle, end in network.bounds for part in (middle - start, end - middle)]


def flat(parameters: Parameters) -> Tensor:
    """float [P], or [N, P] of parameters with a leading axis N, in the order of the layers."""
    leading = parameters["layer0.bias"].dim() - 1
    return torch.cat([value.flatten(leading) for value in parameters.values()], dim=-1)


def shaped(rows: Tensor, network: PolicyNetwork) -> Parameters:
    """Parameters of float [.., P]: views."""
    shapes = network.parameter_shapes
    parts = torch.split(rows, [int(np.prod(shape)) for shape in shapes.values()], dim=-1)
    return {
        name: part.view(*rows.shape[:-1], *shape)
        for part, (name, shape) in zip(parts, shapes.items(), strict=True)
    }


def array_of(tensor: Tensor) -> Array:
    """The same numbers, contiguous."""
    array: Array = tensor.detach().contiguous().numpy()
    return array
