"""The outer objective: its value, and its gradient against finite differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest
import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.exact import expected_return
from merap.learning.gradient_step import StepRule, expected_step, surrogate
from merap.learning.meta import Batch, Objective, batch, objective, step_rule
from merap.learning.policy import Parameters, policy_table, stack_parameters
from merap.learning.rollout import rollout
from merap.mdp import evaluation
from tests.learning_examples import (
    RING_DISCOUNT,
    RING_HORIZON,
    random_parameters,
    ring_batch,
    ring_models,
    seeded,
    smooth_network,
    with_end,
)

SEED = 17
VARIANCE = torch.tensor(3.0, dtype=torch.float64)


def _config(inner_steps: int = 1, order: Literal[1, 2] = 2) -> TrainingConfig:
    return TrainingConfig(inner_steps=inner_steps, order=order, episodes=12, activation="softplus")


def _log_step_sizes(parameters: Parameters) -> Parameters:
    """A different one for each: exp(-1), exp(-0.8), ..."""
    return {
        name: torch.full((1,) * value.dim(), -1 + 0.2 * number, dtype=torch.float64)
        for number, (name, value) in enumerate(parameters.items())
    }


def _objective(
    tasks: Batch, parameters: Parameters, log_step_sizes: Parameters, config: TrainingConfig
) -> Objective:
    network = smooth_network(tasks.tasks)
    return objective(network, parameters, log_step_sizes, VARIANCE, tasks, config, seeded(SEED))


def _gradients(
    tasks: Batch, parameters: Parameters, log_step_sizes: Parameters, config: TrainingConfig
) -> tuple[Tensor, ...]:
    """Of the adapted return: parameters, then log step sizes."""
    leaves, sizes = _leaves(parameters), _leaves(log_step_sizes)
    found = _objective(tasks, leaves, sizes, config)
    return torch.autograd.grad(found.adapted_return, [*leaves.values(), *sizes.values()])


def _leaves(parameters: Parameters) -> Parameters:
    return {name: value.detach().clone().requires_grad_() for name, value in parameters.items()}


@dataclass(frozen=True, eq=False)
class FrozenStep:
    """A step whose noise was drawn once: theta -> theta + alpha (scale dJ/dtheta - noise)."""

    noise: Parameters
    scale: Tensor


def _values(tasks: Batch, parameters: Parameters) -> Tensor:
    """J, [N], of parameters [N, ...]."""
    table = policy_table(smooth_network(tasks.tasks), parameters, tasks.tasks.enabled)
    return expected_return(table, tasks.problem)


def _slopes(tasks: Batch, parameters: Parameters) -> Parameters:
    """dJ/dtheta, [N, ...]."""
    leaves = _leaves(parameters)
    slopes = torch.autograd.grad(_values(tasks, leaves).sum(), list(leaves.values()))
    return dict(zip(leaves, slopes, strict=True))


def _per_task(scale: Tensor, value: Tensor) -> Tensor:
    return scale.view(-1, *(1,) * (value.dim() - 1)) * value


def _drawn(
    tasks: Batch, parameters: Parameters, log_step_sizes: Parameters, config: TrainingConfig
) -> list[FrozenStep]:
    """The noise of every inner step, as the objective draws it."""
    network, enabled = smooth_network(tasks.tasks), tasks.tasks.enabled
    rule = step_rule(config, tasks.tasks.discount)
    sizes = {name: value.exp() for name, value in log_step_sizes.items()}
    adapted, generator, steps = stack_parameters(parameters, tasks.tasks.num_tasks), seeded(SEED), []
    for _ in range(config.inner_steps):
        stepped = expected_step(
            network,
            _leaves(adapted),
            sizes,
            enabled,
            tasks.problem,
            tasks.sampler,
            rule,
            VARIANCE,
            generator,
            1,
        )
        scale = surrogate(stepped.episodes, torch.ones(enabled.shape).double(), rule, VARIANCE).scale
        slopes = _slopes(tasks, adapted)
        moved = {name: value.detach() for name, value in stepped.parameters.items()}
        noise = {
            name: _per_task(scale, slopes[name]) - (moved[name] - value.detach()) / sizes[name]
            for name, value in adapted.items()
        }
        steps.append(FrozenStep(noise, scale))
        adapted = moved
    return steps


def _adapted(
    tasks: Batch, parameters: Parameters, log_step_sizes: Parameters, steps: Sequence[FrozenStep]
) -> Parameters:
    """[N, ...] after steps with frozen noise."""
    adapted = stack_parameters(parameters, tasks.tasks.num_tasks)
    for step in steps:
        slopes = _slopes(tasks, adapted)
        adapted = {
            name: value
            + log_step_sizes[name].exp() * (_per_task(step.scale, slopes[name]) - step.noise[name])
            for name, value in adapted.items()
        }
    return adapted


def _finite_differences(
    tasks: Batch, parameters: Parameters, log_step_sizes: Parameters, steps: Sequence[FrozenStep]
) -> Tensor:
    """Central differences of the adapted return in every parameter and log step size, [P]."""
    whole = (parameters, log_step_sizes)
    flat = torch.cat([value.flatten() for one in whole for value in one.values()])
    sizes = [value.numel() for one in whole for value in one.values()]

    def value(at: Tensor) -> float:
        parts = iter(torch.split(at, sizes))
        moved = [{name: next(parts).view_as(value) for name, value in one.items()} for one in whole]
        return float(_values(tasks, _adapted(tasks, moved[0], moved[1], steps)).mean())

    step = 1e-5
    shifts = step * torch.eye(len(flat), dtype=torch.float64)
    slopes = [(value(flat + shift) - value(flat - shift)) / (2 * step) for shift in shifts]
    return torch.tensor(slopes, dtype=torch.float64)


def _relative_error(found: Tensor, expected: Tensor) -> float:
    return float((found - expected).norm() / expected.norm())


@pytest.mark.parametrize("inner_steps", [1, 3])
def test_the_meta_gradient_is_the_slope_at_frozen_noise(inner_steps: int) -> None:
    """Through all inner steps, in parameters and step sizes; first order is no such gradient.

    Episodes depend on the parameters in jumps, so their noise is held; `_drawn` takes it from
    where the step went.
    """
    tasks = batch(ring_batch())
    parameters = random_parameters(smooth_network(tasks.tasks), 0)
    sizes = _log_step_sizes(parameters)
    steps = _drawn(tasks, parameters, sizes, _config(inner_steps))
    frozen = _values(tasks, _adapted(tasks, parameters, sizes, steps)).mean()
    found = _objective(tasks, _leaves(parameters), sizes, _config(inner_steps)).adapted_return
    assert found.item() == pytest.approx(frozen.item(), rel=1e-12)
    slopes = _finite_differences(tasks, parameters, sizes, steps)
    gradient, first_order = (
        torch.cat([part.flatten() for part in _gradients(tasks, parameters, sizes, config)])
        for config in (_config(inner_steps), _config(inner_steps, order=1))
    )
    assert _relative_error(gradient, slopes) < 1e-6
    assert _relative_error(first_order, slopes) > 0.1


@pytest.mark.parametrize("inner_steps", [1, 3])
def test_first_order_is_the_outer_gradient_at_the_adapted_parameters(inner_steps: int) -> None:
    tasks = batch(ring_batch())
    parameters = random_parameters(smooth_network(tasks.tasks), 0)
    sizes = _log_step_sizes(parameters)
    steps = _drawn(tasks, parameters, sizes, _config(inner_steps))
    adapted = _adapted(tasks, parameters, sizes, steps)
    slopes = _slopes(tasks, adapted)
    found = _gradients(tasks, parameters, sizes, _config(inner_steps, order=1))
    start = stack_parameters(parameters, 3)
    of_parameters = [slopes[name].mean(dim=0) for name in parameters]
    # theta' = theta + alpha x, with x a constant: d/d log alpha = (theta' - theta) dJ/dtheta'
    of_sizes = [
        ((adapted[name] - start[name]) * slopes[name]).sum().view(sizes[name].shape) / 3 for name in sizes
    ]
    for one, expected in zip(found, (*of_parameters, *of_sizes), strict=True):
        torch.testing.assert_close(one, expected, rtol=1e-9, atol=1e-11)


def test_the_meta_return_is_that_of_the_numpy_recursion() -> None:
    tasks = batch(ring_batch())
    network = smooth_network(tasks.tasks)
    parameters = random_parameters(network, 0)
    found = _objective(tasks, _leaves(parameters), _log_step_sizes(parameters), _config())
    tables = policy_table(network, stack_parameters(parameters, 3), tasks.tasks.enabled)
    expected = [
        evaluation.expected_return(model, with_end(table, model), RING_HORIZON, RING_DISCOUNT)
        for model, table in zip(ring_models(), tables, strict=True)
    ]
    assert found.meta_return.item() == pytest.approx(np.mean(expected), rel=1e-12)
    assert not found.meta_return.requires_grad


def test_the_entropy_is_that_over_the_steps_of_the_first_episodes() -> None:
    tasks = batch(ring_batch())
    network, enabled = smooth_network(tasks.tasks), tasks.tasks.enabled
    parameters = random_parameters(network, 0)
    found = _objective(tasks, _leaves(parameters), _log_step_sizes(parameters), _config(3))
    table = policy_table(network, stack_parameters(parameters, 3), enabled)
    episodes = rollout(table, tasks.sampler, _config().episodes, seeded(SEED))
    entropies = torch.special.entr(table).sum(dim=-1)
    task = torch.arange(3).view(-1, 1, 1).expand_as(episodes.state)
    expected = entropies[task, episodes.state][episodes.active].mean()
    torch.testing.assert_close(found.entropy, expected, rtol=1e-12, atol=0)


def test_the_entropy_of_the_uniform_policy() -> None:
    """The first step of the ring has 4 actions at location S or A: the entropy is log 4."""
    tasks = batch(replace(ring_batch(), horizon=1))
    zeros = {
        name: torch.zeros_like(value)
        for name, value in random_parameters(smooth_network(tasks.tasks), 0).items()
    }
    assert set(tasks.tasks.enabled[tasks.tasks.initial > 0].sum(dim=-1).tolist()) == {4}
    found = _objective(tasks, _leaves(zeros), _log_step_sizes(zeros), _config())
    assert found.entropy.item() == pytest.approx(math.log(4), rel=1e-12)


def test_the_variance_is_that_of_the_advantages_of_every_step() -> None:
    tasks = batch(ring_batch())
    parameters = random_parameters(smooth_network(tasks.tasks), 0)
    sizes, config = _log_step_sizes(parameters), _config(2)
    rule = step_rule(config, RING_DISCOUNT)
    adapted, generator, seen = stack_parameters(parameters, 3), seeded(SEED), []
    for _ in range(2):
        stepped = expected_step(
            smooth_network(tasks.tasks),
            _leaves(adapted),
            {name: value.exp() for name, value in sizes.items()},
            tasks.tasks.enabled,
            tasks.problem,
            tasks.sampler,
            rule,
            VARIANCE,
            generator,
            1,
        )
        adapted = stepped.parameters
        seen.append(stepped.variance)
    found = _objective(tasks, _leaves(parameters), sizes, config)
    torch.testing.assert_close(found.variance, torch.stack(seen).mean().detach())


def test_a_short_step_from_many_episodes_improves_the_return() -> None:
    tasks = batch(ring_batch())
    parameters = random_parameters(smooth_network(tasks.tasks), 0)
    config = TrainingConfig(episodes=2_000, activation="softplus")
    sizes = {name: value - 2 for name, value in _log_step_sizes(parameters).items()}
    found = _objective(tasks, _leaves(parameters), sizes, config)
    assert found.adapted_return.item() > found.meta_return.item() + 0.01


def test_the_rule_holds_the_settings() -> None:
    config = TrainingConfig(
        episodes=7,
        baseline="time",
        ridge=2.0,
        gae_lambda=0.5,
        variance_prior=3.0,
        noise_episodes=4.0,
        exploration=0.2,
    )
    assert step_rule(config, 0.8) == StepRule(0.8, 7, "time", 2.0, 0.5, 3.0, 4.0, 0.2)
