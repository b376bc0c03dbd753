"""Policies: probabilities, masks, both kinds of observation, one set of parameters per task."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch

from merap.learning.config import Activation
from merap.learning.policy import (
    PolicyNetwork,
    action_logits,
    explore,
    initial_parameters,
    log_policy,
    policy_table,
    stack_parameters,
)
from tests.support.learning_examples import grid_batch, random_parameters, ring_batch, seeded

ACTIVATIONS: list[Activation] = ["relu", "tanh", "softplus"]
MODULES = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh, "softplus": torch.nn.Softplus}


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("hidden", [(), (7,), (6, 5)])
def test_logits_equal_those_of_torchs_own_layers(activation: Activation, hidden: tuple[int, ...]) -> None:
    network = PolicyNetwork(9, 4, hidden, activation)
    parameters = random_parameters(network, 0)
    model = torch.nn.Sequential()
    for layer, (inputs, outputs) in enumerate(pairwise(network.layer_sizes)):
        if layer:
            model.append(MODULES[activation]())
        linear = torch.nn.Linear(inputs, outputs, dtype=torch.float64)
        linear.load_state_dict(
            {"weight": parameters[f"layer{layer}.weight"].T, "bias": parameters[f"layer{layer}.bias"]}
        )
        model.append(linear)
    one_hot = torch.eye(9, dtype=torch.float64)
    torch.testing.assert_close(action_logits(network, parameters), model(one_hot), rtol=1e-12, atol=1e-12)


def test_a_one_hot_observation_is_a_row_of_the_identity() -> None:
    """The weight that stands for the product, and its gradient."""
    plain = PolicyNetwork(9, 4, (6,), "tanh")
    factored = PolicyNetwork(9, 4, (6,), "tanh", features=torch.eye(9, dtype=torch.float64))
    parameters = {name: value.requires_grad_() for name, value in random_parameters(plain, 1).items()}
    gathered, product = action_logits(plain, parameters), action_logits(factored, parameters)
    torch.testing.assert_close(gathered, product, rtol=1e-12, atol=1e-12)
    weight = torch.randn(gathered.shape, generator=seeded(2), dtype=torch.float64)
    found = torch.autograd.grad(gathered, list(parameters.values()), weight)
    expected = torch.autograd.grad(product, list(parameters.values()), weight)
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-12)


def test_features_make_states_alike() -> None:
    features = torch.tensor([[0.0, 1.0], [2.0, -1.0], [0.0, 1.0]], dtype=torch.float64)
    network = PolicyNetwork(3, 4, (5,), features=features)
    assert network.layer_sizes == (2, 5, 4)
    parameters = random_parameters(network, 0)
    logits = action_logits(network, parameters)
    hidden = torch.relu(features @ parameters["layer0.weight"] + parameters["layer0.bias"])
    expected = hidden @ parameters["layer1.weight"] + parameters["layer1.bias"]
    torch.testing.assert_close(logits, expected, rtol=1e-12, atol=1e-12)
    assert torch.equal(logits[0], logits[2])
    assert not torch.equal(logits[0], logits[1])


@pytest.mark.parametrize("features", [None, torch.eye(82, dtype=torch.float64)[:, :7]])
def test_a_leading_axis_is_one_policy_per_task(features: torch.Tensor | None) -> None:
    network = PolicyNetwork(82, 5, (6, 5), features=features)
    sets = [random_parameters(network, seed) for seed in range(3)]
    stacked = {name: torch.stack([one[name] for one in sets]) for name in sets[0]}
    expected = torch.stack([action_logits(network, one) for one in sets])
    torch.testing.assert_close(action_logits(network, stacked), expected, rtol=1e-12, atol=1e-12)


def test_stacked_copies_share_their_gradient() -> None:
    tasks = ring_batch()
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, (4,))
    parameters = {name: value.requires_grad_() for name, value in random_parameters(network, 0).items()}
    stacked = stack_parameters(parameters, 3)
    assert {len(value) for value in stacked.values()} == {3}
    weight = torch.randn(3, tasks.num_states, tasks.num_actions, generator=seeded(1), dtype=torch.float64)
    found = torch.autograd.grad(action_logits(network, stacked), list(parameters.values()), weight)
    alone = torch.autograd.grad(
        action_logits(network, parameters), list(parameters.values()), weight.sum(dim=0)
    )
    torch.testing.assert_close(found, alone, rtol=1e-12, atol=1e-12)


def test_probabilities_are_the_softmax_over_enabled_actions() -> None:
    tasks = ring_batch()
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, (4,))
    parameters = random_parameters(network, 0)
    table = policy_table(network, parameters, tasks.enabled)
    weights = action_logits(network, parameters).exp() * tasks.enabled
    expected = weights / weights.sum(dim=-1, keepdim=True).clamp_min(1e-300)
    torch.testing.assert_close(table, expected, rtol=1e-12, atol=1e-14)
    assert torch.all(table[~tasks.enabled] == 0)
    assert torch.equal(table.sum(dim=-1) > 0.5, tasks.enabled.any(dim=-1))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [1.0, 1e4])
def test_rows_without_an_enabled_action_are_finite_and_have_no_gradient(
    dtype: torch.dtype, size: float
) -> None:
    enabled = torch.tensor([[False, False, False], [True, False, True], [False, True, False]])
    logits = (size * torch.randn(3, 3, generator=seeded(0), dtype=dtype)).requires_grad_()
    log_probs = log_policy(logits, enabled)
    assert torch.isfinite(log_probs).all()
    assert torch.all(log_probs[0] == log_probs[0, 0])
    assert torch.all(log_probs.exp()[1:][~enabled[1:]] == 0)
    probs = log_probs.exp() * enabled
    assert probs[0].tolist() == [0, 0, 0]
    (gradient,) = torch.autograd.grad((probs * log_probs).sum(), logits, create_graph=True)
    (second,) = torch.autograd.grad(gradient.square().sum(), logits)
    for found in (gradient, second):
        assert torch.isfinite(found).all()
        assert torch.all(found[~enabled] == 0)


def test_a_whole_grid_policy_has_finite_gradients() -> None:
    """Unreachable cells and the completed state have no enabled action."""
    tasks = grid_batch()
    network = PolicyNetwork(tasks.num_states, tasks.num_actions)
    parameters = {name: value.requires_grad_() for name, value in random_parameters(network, 0).items()}
    table = policy_table(network, stack_parameters(parameters, 2), tasks.enabled)
    entropy = -(table * log_policy(action_logits(network, parameters), tasks.enabled)).sum()
    for gradient in torch.autograd.grad(entropy, list(parameters.values())):
        assert torch.isfinite(gradient).all()


def test_exploration_mixes_with_the_uniform_policy() -> None:
    enabled = torch.tensor([[True, True, False, True], [False, True, False, False], [False] * 4])
    probs = torch.tensor([[0.7, 0.3, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0] * 4])
    mixed = explore(probs, enabled, 0.3)
    expected = [[0.49 + 0.1, 0.21 + 0.1, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0], [0.0] * 4]
    torch.testing.assert_close(mixed, torch.tensor(expected))
    assert torch.equal(explore(probs, enabled, 0.0), probs)
    torch.testing.assert_close(explore(probs, enabled, 1.0)[0], torch.tensor([1 / 3, 1 / 3, 0, 1 / 3]))


def test_exploration_keeps_double_precision() -> None:
    enabled = torch.tensor([True, True, False, True])
    probs = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)
    expected = torch.tensor([0.9 + 0.1 / 3, 0.1 / 3, 0.0, 0.1 / 3], dtype=torch.float64)
    torch.testing.assert_close(explore(probs, enabled, 0.1), expected, rtol=1e-14, atol=0)


def test_initial_weights_are_glorot_uniform() -> None:
    network = PolicyNetwork(82, 5, (32, 32))
    parameters = initial_parameters(network, seeded(0), torch.float64)
    assert [tuple(value.shape) for value in parameters.values()] == [
        (82, 32),
        (32,),
        (32, 32),
        (32,),
        (32, 5),
        (5,),
    ]
    for layer, (inputs, outputs) in enumerate(pairwise(network.layer_sizes)):
        weight, bound = parameters[f"layer{layer}.weight"], math.sqrt(6 / (inputs + outputs))
        assert weight.abs().max() <= bound
        # variance of a uniform one, 2 / (inputs + outputs); the fourth moment gives the standard error
        error = bound**2 * math.sqrt(4 / 45 / weight.numel())
        assert abs(weight.square().mean() - 2 / (inputs + outputs)) < 4 * error
        assert torch.all(parameters[f"layer{layer}.bias"] == 0)


def test_initial_weights_depend_on_the_generator_alone() -> None:
    network = PolicyNetwork(5, 3)
    drawn = [initial_parameters(network, seeded(seed))["layer0.weight"] for seed in (1, 1, 2)]
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])
    assert drawn[0].dtype == torch.float32
