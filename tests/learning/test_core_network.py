"""Derivatives of networks, written out, against torch's."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
import torch
from torch import Tensor

from merap.learning.core.network import Activation, forward, pullback, pullback_dot, pushforward
from merap.learning.layout import array_of, core_network, flat, per_entry, per_parameter, shaped
from merap.learning.policy import PolicyNetwork, action_logits
from tests.support.learning_examples import random_parameters, seeded

STATES, ACTIONS, TASKS = 7, 3, 3
SHAPES = [
    (hidden, activation, features)
    for hidden, activation, features in product(
        [(), (5,), (5, 4)], ["relu", "tanh", "softplus"], [False, True]
    )
]


def _network(hidden: tuple[int, ...], activation: Activation, features: bool) -> PolicyNetwork:
    table = torch.randn(STATES, 6, generator=seeded(9), dtype=torch.float64) if features else None
    return PolicyNetwork(STATES, ACTIONS, hidden, activation, table)


def _theta(network: PolicyNetwork, *, shared: bool) -> Tensor:
    rows = torch.stack([flat(random_parameters(network, seed)) for seed in range(TASKS)])
    return rows[0] if shared else rows


def _normal(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, generator=seeded(seed), dtype=torch.float64)


def _along(function: Callable[[Tensor], Tensor], at: Tensor, direction: Tensor) -> Tensor:
    """The derivative along a direction, by torch: backward through a backward pass."""
    leaf = at.detach().clone().requires_grad_()
    value = function(leaf)
    weight = torch.zeros_like(value, requires_grad=True)
    (back,) = torch.autograd.grad(value, leaf, weight, create_graph=True)
    (along,) = torch.autograd.grad(back, weight, direction)
    return along


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(("hidden", "activation", "features"), SHAPES)
def test_derivatives_equal_those_of_automatic_differentiation(
    hidden: tuple[int, ...], activation: Activation, features: bool, shared: bool
) -> None:
    """Of a loss that is quadratic in the logits."""
    network = _network(hidden, activation, features)
    theta = _theta(network, shared=shared)
    rows = theta.expand(TASKS, -1).contiguous()
    direction = _normal(*rows.shape, seed=1)
    weight = _normal(TASKS, STATES, ACTIONS, seed=2)
    half = _normal(TASKS, STATES, ACTIONS, ACTIONS, seed=3)
    curve = half + half.mT
    core = core_network(network, torch.float64)

    at = forward(array_of(theta), core)
    logits = torch.from_numpy(at.logits).expand(weight.shape)
    slope = weight + torch.einsum("nsab,nsb->nsa", curve, logits)
    gradient, cotangents = pullback(array_of(theta), core, at, array_of(slope))

    def torch_gradient(at: Tensor) -> Tensor:
        leaf = at if at.requires_grad else at.clone().requires_grad_()
        logits = action_logits(network, shaped(leaf, network))
        loss = (weight * logits).sum() + torch.einsum("nsa,nsab,nsb->", logits, curve, logits) / 2
        (found,) = torch.autograd.grad(loss, leaf, create_graph=True)
        return found

    np.testing.assert_allclose(gradient, torch_gradient(rows).detach(), rtol=1e-10, atol=1e-12)
    tangent = pushforward(array_of(theta), core, at, array_of(direction))
    logits_dot = _along(lambda at: action_logits(network, shaped(at, network)), rows, direction)
    np.testing.assert_allclose(tangent.logits, logits_dot, rtol=1e-10, atol=1e-12)

    slope_dot = array_of(torch.einsum("nsab,nsb->nsa", curve, logits_dot))
    arguments = (array_of(theta), core, at, cotangents, array_of(direction), tangent, slope_dot)
    found = pullback_dot(*arguments)
    expected = _along(torch_gradient, rows, direction)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)
    if shared:
        summed = pullback_dot(*arguments, summed=True)
        np.testing.assert_allclose(summed, found.sum(axis=0), rtol=1e-10, atol=1e-12)


def test_parameters_stand_in_the_order_of_the_layers() -> None:
    network = _network((5, 4), "relu", features=False)
    parameters = random_parameters(network, 0)
    theta = array_of(flat(parameters))
    core = core_network(network, torch.float64)
    for layer, (start, middle, end) in enumerate(core.bounds):
        weight = parameters[f"layer{layer}.weight"]
        np.testing.assert_array_equal(theta[start:middle].reshape(weight.shape), weight)
        np.testing.assert_array_equal(theta[middle:end], parameters[f"layer{layer}.bias"])
    back = shaped(torch.from_numpy(theta), network)
    assert all(torch.equal(back[name], value) for name, value in parameters.items())


def test_numbers_per_parameter_are_spread_and_summed_up() -> None:
    core = core_network(_network((5, 4), "relu", features=False), torch.float64)
    entries = per_entry(np.arange(6.0), core)
    assert len(entries) == 7 * 5 + 5 + 5 * 4 + 4 + 4 * 3 + 3
    assert entries[34:41].tolist() == [0, 1, 1, 1, 1, 1, 2]
    counts = per_parameter(np.ones_like(entries), core)
    assert counts.tolist() == [35, 5, 20, 4, 12, 3]
