"""Stochastic policies as pure functions of a dictionary of parameters.

A policy is a multilayer perceptron from an observation of the state to one logit per
action. Parameters may carry a leading axis N: one set for each task. They stand under their names, or all
in one row.

Axes: N tasks, S states, A actions, F features, P parameters in one row, L layers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import torch
from torch import Tensor

from merap.learning.config import Activation

Parameters = dict[str, Tensor]

# Finite, because 0 * inf is NaN in a backward pass; exp of it is 0 next to any logit.
DISABLED_LOGIT = -1e9


_ACTIVATIONS: Mapping[Activation, Callable[[Tensor], Tensor]] = {
    "relu": torch.relu,
    "tanh": torch.tanh,
    "softplus": torch.nn.functional.softplus,
}


@dataclass(frozen=True, eq=False)
class PolicyNetwork:
    """The shape of a policy; its parameters stand beside it.

    Attributes:
        num_states: S.
        num_actions: A.
        hidden: sizes of the hidden layers.
        activation: between the layers.
        features: float [S, F], the observation of each state; None observes the state
            itself, one-hot.
    """

    num_states: int
    num_actions: int
    hidden: tuple[int, ...] = (32, 32)
    activation: Activation = "relu"
    features: Tensor | None = None

    def __post_init__(self) -> None:
        assert self.features is None or self.features.shape[0] == self.num_states, self.num_states

    @cached_property
    def layer_sizes(self) -> tuple[int, ...]:
        """Observation, hidden layers, actions."""
        observed = self.num_states if self.features is None else self.features.shape[1]
        return (observed, *self.hidden, self.num_actions)

    @cached_property
    def parameter_shapes(self) -> dict[str, tuple[int, ...]]:
        """By name: `layer<i>.weight` [inputs, outputs], then `layer<i>.bias` [outputs]."""
        shapes: dict[str, tuple[int, ...]] = {}
        for layer, (inputs, outputs) in enumerate(pairwise(self.layer_sizes)):
            shapes[f"layer{layer}.weight"] = (inputs, outputs)
            shapes[f"layer{layer}.bias"] = (outputs,)
        return shapes

    @cached_property
    def parameter_sizes(self) -> list[int]:
        """2 L numbers: how many entries each weight and bias has."""
        return [math.prod(shape) for shape in self.parameter_shapes.values()]

    @property
    def num_layers(self) -> int:
        """Hidden layers and the last one."""
        return len(self.hidden) + 1


def initial_parameters(
    network: PolicyNetwork, generator: torch.Generator, dtype: torch.dtype = torch.float32
) -> Parameters:
    """Random weights, uniform after Glorot and Bengio (2010, eq. 16), and biases of 0.

    Returns:
        `layer<i>.weight` float [inputs, outputs] and `layer<i>.bias` float [outputs].
    """
    parameters: Parameters = {}
    sizes = network.layer_sizes
    for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
        bound = math.sqrt(6 / (inputs + outputs))
        uniform = torch.rand(inputs, outputs, generator=generator, dtype=dtype)
        parameters[f"layer{layer}.weight"] = bound * (2 * uniform - 1)
        parameters[f"layer{layer}.bias"] = torch.zeros(outputs, dtype=dtype)
    return parameters


def action_logits(network: PolicyNetwork, parameters: Parameters) -> Tensor:
    """Logits of all actions in every state, of disabled ones too; differentiable by torch.

    Args:
        network: the policy's shape.
        parameters: as `initial_parameters` makes them, maybe with a leading axis N.

    Returns:
        float [S, A], or [N, S, A].
    """
    activate = _ACTIVATIONS[network.activation]
    # a one-hot observation times the weight is a row of the weight
    weight = parameters["layer0.weight"]
    signal = weight if network.features is None else network.features.to(weight.dtype) @ weight
    signal = signal + parameters["layer0.bias"].unsqueeze(-2)
    # one call for product and bias: on small networks calls are what takes time
    affine = torch.addmm if weight.dim() == 2 else torch.baddbmm
    for layer in range(1, network.num_layers):
        bias, weight = parameters[f"layer{layer}.bias"], parameters[f"layer{layer}.weight"]
        signal = affine(bias.unsqueeze(-2), activate(signal), weight)
    return signal


def log_policy(logits: Tensor, enabled: Tensor) -> Tensor:
    """Log-probabilities of the actions, over the enabled ones.

    Args:
        logits: float [..., A].
        enabled: bool [..., A], broadcast against `logits`.

    Returns:
        float [..., A]; about -1e9 for a disabled action. A row without an enabled action is
        finite too, and means nothing.
    """
    return torch.log_softmax(torch.where(enabled, logits, DISABLED_LOGIT), dim=-1)


def masked_softmax(logits: Tensor, enabled: Tensor) -> Tensor:
    """Probabilities of the actions, over the enabled ones.

    Args:
        logits: float [..., A].
        enabled: bool [..., A], broadcast against `logits`.

    Returns:
        float [..., A], rows sum to 1, those without an enabled action to 0.
    """
    return softmax(torch.where(enabled, logits, DISABLED_LOGIT)) * enabled


def softmax(logits: Tensor) -> Tensor:
    """Probabilities of the actions [..., A]; torch's own is slow over an axis of a few actions."""
    powers = (logits - logits.detach().amax(dim=-1, keepdim=True)).exp()
    return powers / powers.sum(dim=-1, keepdim=True)


def policy_table(network: PolicyNetwork, parameters: Parameters, enabled: Tensor) -> Tensor:
    """Action probabilities in every state.

    Args:
        network: the policy's shape.
        parameters: its parameters, maybe with a leading axis N.
        enabled: bool [..., S, A].

    Returns:
        float [..., S, A], rows sum to 1, those without an enabled action to 0.
    """
    return masked_softmax(action_logits(network, parameters), enabled)


def explore(probabilities: Tensor, enabled: Tensor, exploration: float) -> Tensor:
    """Mix a policy with the uniform one over the enabled actions.

    Args:
        probabilities: float [..., S, A].
        enabled: bool [..., S, A].
        exploration: weight of the uniform policy, in [0, 1].

    Returns:
        float [..., S, A].
    """
    if exploration == 0:
        return probabilities
    available = enabled.to(probabilities.dtype)
    uniform = available / available.sum(dim=-1, keepdim=True).clamp_min(1)
    return torch.lerp(probabilities, uniform.expand_as(probabilities), exploration)


def stack_parameters(parameters: Parameters, copies: int) -> Parameters:
    """The same parameters for each of N tasks: views [N, ...] of [...]."""
    return {name: value.expand(copies, *value.shape) for name, value in parameters.items()}


def flat(parameters: Parameters) -> Tensor:
    """Put parameters into one row [P], or [N, P] of parameters with a leading axis N."""
    leading = parameters["layer0.bias"].dim() - 1
    return torch.cat([value.flatten(leading) for value in parameters.values()], dim=-1)


def shaped(rows: Tensor, network: PolicyNetwork) -> Parameters:
    """Return the parameters that stand in rows [P] or [N, P]: views."""
    parts = torch.split_with_sizes(rows, network.parameter_sizes, dim=-1)
    return {
        name: part.view(*rows.shape[:-1], *shape)
        for part, (name, shape) in zip(parts, network.parameter_shapes.items(), strict=True)
    }
