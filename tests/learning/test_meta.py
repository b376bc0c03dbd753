"""The outer objective: its value, and its gradient against finite differences in double precision."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
import pytest
import torch

from merap.learning.config import Estimator, TrainingConfig
from merap.learning.core.jit import Array
from merap.learning.core.meta import Drawn, Seen, adapt_again
from merap.learning.core.network import Activation, forward, pullback
from merap.learning.core.softmax import through_softmax
from merap.learning.core.values import values
from merap.learning.exact import Span, exact_problem, expected_return
from merap.learning.gradient_step import StepRule, sampled_step
from merap.learning.layout import array_of, core_network, core_tasks, flat, per_entry, shaped
from merap.learning.meta import Objective, OuterGradient, outer_objective, ranges, step_rule
from merap.learning.policy import Parameters, PolicyNetwork, policy_table, stack_parameters
from merap.learning.rollout import drawn_episodes, rollout, sampler
from merap.learning.tasks import TaskBatch
from tests.support.learning_examples import RING_DISCOUNT, RING_HORIZON, random_parameters, ring_batch, seeded

SEED = 17
VARIANCE = torch.tensor(3.0, dtype=torch.float64)
SIZES = np.exp(-1 + 0.2 * np.arange(4))
Order = Literal[1, 2]


def _config(
    estimator: Estimator = "exact",
    inner_steps: int = 1,
    order: Order = 2,
    activation: Activation = "softplus",
    span: Span = "horizon",
) -> TrainingConfig:
    return TrainingConfig(
        estimator=estimator,
        inner_steps=inner_steps,
        order=order,
        episodes=12,
        hidden=(4,),
        activation=activation,
        span=span,
    )


@dataclass(frozen=True)
class Setting:
    """Three tasks, a policy, and how it is adapted."""

    config: TrainingConfig
    tasks: TaskBatch
    network: PolicyNetwork
    theta: Array

    def objective(self, log_sizes: Array | None = None) -> Objective:
        network = core_network(self.network, torch.float64)
        return outer_objective(
            ranges(core_tasks(self.tasks, self.tasks.discount), network),
            network,
            SIZES if log_sizes is None else np.exp(log_sizes),
            step_rule(self.config, self.tasks.discount),
            VARIANCE,
            self.config,
            self.tasks.horizon,
            torch.get_num_threads(),
        )

    def drawn(self) -> tuple[OuterGradient, list[Drawn], Seen]:
        return self.objective().draw_and_differentiate(
            self.theta, self.config, self.tasks.horizon, seeded(SEED)
        )

    @property
    def parameters(self) -> Parameters:
        return shaped(torch.from_numpy(self.theta), self.network)


def _setting(config: TrainingConfig) -> Setting:
    tasks = ring_batch()
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, config.hidden, config.activation)
    return Setting(config, tasks, network, array_of(flat(random_parameters(network, 0))))


def _slopes(value: Callable[[Array], float], at: Array) -> Array:
    """Central differences in every entry."""
    step = 1e-5
    shifts = step * np.eye(len(at))
    return np.array([(value(at + shift) - value(at - shift)) / (2 * step) for shift in shifts])


def _relative_error(found: Array, expected: Array) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


CASES = [
    *product(("exact", "sampled"), (1, 3), ("softplus", "tanh"), ("horizon",)),
    *product(("exact",), (1, 3), ("softplus",), ("infinite",)),
]


@pytest.mark.parametrize(("estimator", "inner_steps", "activation", "span"), CASES)
def test_the_meta_gradient_is_the_slope_with_what_was_drawn_held(
    estimator: Estimator, inner_steps: int, activation: Activation, span: Span
) -> None:
    """Second order, in theta and log alpha: episodes, their noise and old log-probabilities are fixed."""
    setting = _setting(_config(estimator, inner_steps, activation=activation, span=span))
    gradient, drawn, _ = setting.drawn()
    in_theta = _slopes(lambda theta: setting.objective().judge(theta, drawn)[0], setting.theta)
    in_sizes = _slopes(lambda log: setting.objective(log).judge(setting.theta, drawn)[0], np.log(SIZES))
    assert _relative_error(gradient.theta, in_theta) < 1e-6
    assert _relative_error(gradient.sizes, in_sizes) < 1e-6
    again = setting.objective().differentiate_again(setting.theta, drawn)
    np.testing.assert_allclose(again.theta, gradient.theta, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(again.sizes, gradient.sizes, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_repeated_gradients_are_slopes_elsewhere(estimator: Estimator) -> None:
    """As outer_repeats takes them: away from where episodes were drawn, ratios are no longer 1."""
    setting = _setting(_config(estimator, 2))
    _, drawn, _ = setting.drawn()
    elsewhere = setting.theta + 0.05 * np.random.default_rng(3).standard_normal(len(setting.theta))
    found = setting.objective().differentiate_again(elsewhere, drawn)
    slopes = _slopes(lambda theta: setting.objective().judge(theta, drawn)[0], elsewhere)
    assert _relative_error(found.theta, slopes) < 1e-6


@pytest.mark.parametrize("inner_steps", [1, 3])
@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_first_order_is_the_outer_gradient_at_the_adapted_parameters(
    estimator: Estimator, inner_steps: int
) -> None:
    """And no gradient of the adapted worth."""
    setting = _setting(_config(estimator, inner_steps, order=1))
    gradient, drawn, _ = setting.drawn()
    (problem,) = setting.objective().problems
    after = adapt_again(problem, setting.theta, drawn[0].losses).after
    worth = drawn[0].worth
    if worth is None:
        worth = values(after.table, problem.tasks, problem.horizon).gradient
    outer, _ = pullback(after.theta, problem.network, after.at, through_softmax(after.table, worth))
    np.testing.assert_allclose(gradient.theta, outer.mean(axis=0), rtol=1e-10, atol=1e-12)
    slopes = _slopes(lambda theta: setting.objective().judge(theta, drawn)[0], setting.theta)
    assert _relative_error(gradient.theta, slopes) > 0.01


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_curvature_is_that_of_the_divergence(estimator: Estimator) -> None:
    """KL(theta + h u) = h^2 u' F u / 2 + O(h^3); both signs of h cancel the odd term."""
    setting = _setting(_config(estimator, 2))
    _, drawn, _ = setting.drawn()
    objective = setting.objective()
    product_with = objective.curvature(setting.theta, drawn)
    assert objective.judge(setting.theta, drawn)[1] == pytest.approx(0, abs=1e-12)
    generator = np.random.default_rng(5)
    for _ in range(5):
        direction = generator.standard_normal(len(setting.theta))
        step = 1e-4 * direction
        both = sum(objective.judge(setting.theta + sign * step, drawn)[1] for sign in (1, -1))
        assert direction @ product_with(direction) == pytest.approx(both / 1e-8, rel=1e-4)


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_an_inner_step_goes_where_the_online_step_goes(estimator: Estimator) -> None:
    """Expectation and noise add up to the step from the same episodes (`gradient_step`)."""
    setting = _setting(_config(estimator))
    _, drawn, _ = setting.drawn()
    (problem,) = setting.objective().problems
    found = adapt_again(problem, setting.theta, drawn[0].losses).after.theta
    rule = step_rule(setting.config, RING_DISCOUNT)
    start = stack_parameters(setting.parameters, 3)
    draws = torch.rand(
        (3, drawn_rounds(setting), 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64
    )
    table = policy_table(setting.network, start, setting.tasks.enabled)
    episodes = drawn_episodes(table, sampler(setting.tasks), draws[:, 0])
    sizes = dict(zip(start, torch.from_numpy(SIZES), strict=True))
    rule = StepRule(**{**vars(rule), "exploration": 0.0})
    stepped = sampled_step(setting.network, start, sizes, setting.tasks.enabled, episodes, rule, VARIANCE)
    np.testing.assert_allclose(found, array_of(flat(stepped.parameters)), rtol=1e-9, atol=1e-11)


def drawn_rounds(setting: Setting) -> int:
    """Episodes are drawn for every inner step; by the sampled estimator for the adapted policies too."""
    return setting.config.inner_steps + (setting.config.estimator == "sampled")


def test_without_noise_a_step_follows_the_gradient_of_the_exact_return() -> None:
    setting = _setting(_config().model_copy(update={"sampling_noise": False}))
    _, drawn, _ = setting.drawn()
    (problem,) = setting.objective().problems
    found = adapt_again(problem, setting.theta, drawn[0].losses).after.theta
    leaves = {
        name: value.clone().requires_grad_()
        for name, value in stack_parameters(setting.parameters, 3).items()
    }
    table = policy_table(setting.network, leaves, setting.tasks.enabled)
    returns = expected_return(table, exact_problem(setting.tasks))
    slopes = flat(dict(zip(leaves, torch.autograd.grad(returns.sum(), list(leaves.values())), strict=True)))
    scale = drawn[0].losses[0].scale
    assert scale is not None
    alpha = per_entry(SIZES, problem.network)
    np.testing.assert_allclose(
        found, setting.theta + alpha * scale[:, np.newaxis] * array_of(slopes), rtol=1e-10
    )


def test_what_is_seen_is_what_the_policies_earn() -> None:
    setting = _setting(_config(inner_steps=2))
    _, drawn, seen = setting.drawn()
    start = stack_parameters(setting.parameters, 3)
    table = policy_table(setting.network, start, setting.tasks.enabled)
    problem = exact_problem(setting.tasks)
    np.testing.assert_allclose(seen.meta_return, expected_return(table, problem), rtol=1e-12)
    adapted = torch.from_numpy(drawn[0].old)
    np.testing.assert_allclose(seen.adapted_return, expected_return(adapted, problem), rtol=1e-12)
    assert setting.objective().judge(setting.theta, drawn)[0] == pytest.approx(seen.adapted_return.mean())


def test_sampled_returns_are_those_of_the_episodes() -> None:
    setting = _setting(_config("sampled"))
    _, _, seen = setting.drawn()
    start = stack_parameters(setting.parameters, 3)
    draws = torch.rand((3, 2, 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64)
    table = policy_table(setting.network, start, setting.tasks.enabled)
    reward = drawn_episodes(table, sampler(setting.tasks), draws[:, 0]).reward
    discounts = RING_DISCOUNT ** torch.arange(RING_HORIZON, dtype=torch.float64)
    np.testing.assert_allclose(seen.meta_return, (reward @ discounts).mean(dim=1), rtol=1e-12)


def test_entropy_and_its_gradient_are_those_over_the_steps_of_the_first_episodes() -> None:
    setting = _setting(_config(inner_steps=3))
    gradient, _, seen = setting.drawn()
    leaves = {name: value.clone().requires_grad_() for name, value in setting.parameters.items()}
    table = policy_table(setting.network, leaves, setting.tasks.enabled)
    draws = torch.rand((3, 3, 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64)
    episodes = drawn_episodes(table, sampler(setting.tasks), draws[:, 0])
    entropies = -(table * table.clamp_min(1e-300).log()).sum(dim=-1)
    of_tasks = [
        entropies[n, episodes.state[n][episodes.active[n]]].mean() for n in range(setting.tasks.num_tasks)
    ]
    mean = torch.stack(of_tasks).mean()
    assert seen.entropy.mean() == pytest.approx(mean.item(), rel=1e-12)
    slopes = torch.autograd.grad(mean, list(leaves.values()))
    np.testing.assert_allclose(
        gradient.entropy, torch.cat([slope.flatten() for slope in slopes]), rtol=1e-9, atol=1e-12
    )


def test_the_entropy_of_the_uniform_policy() -> None:
    """The first step of the ring has 4 actions at location S or A: the entropy is log 4."""
    setting = _setting(_config())
    tasks = replace(setting.tasks, horizon=1)
    uniform = Setting(setting.config, tasks, setting.network, np.zeros_like(setting.theta))
    assert set(tasks.enabled[tasks.initial > 0].sum(dim=-1).tolist()) == {4}
    np.testing.assert_allclose(uniform.drawn()[2].entropy, math.log(4), rtol=1e-12)


def test_ranges_and_threads_change_nothing_but_rounding() -> None:
    """20 tasks are three ranges; each task's share is the same, and sums are in order."""
    setting = _setting(_config())
    many = Setting(setting.config, setting.tasks[torch.arange(20) % 3], setting.network, setting.theta)
    objective = many.objective()
    assert [len(problem.tasks.live) for problem in objective.problems] == [6, 7, 7]
    before = torch.get_num_threads()
    found = []
    for threads in (1, 2, 4):
        torch.set_num_threads(threads)
        found.append(many.drawn()[0])
    torch.set_num_threads(before)
    for other in found[1:]:
        assert np.array_equal(found[0].theta, other.theta)
        assert np.array_equal(found[0].sizes, other.sizes)


def test_a_short_step_from_many_episodes_improves_the_return() -> None:
    config = _config().model_copy(update={"episodes": 2_000})
    setting = _setting(config)
    objective = setting.objective(np.log(SIZES) - 2)
    _, _, seen = objective.draw_and_differentiate(setting.theta, config, RING_HORIZON, seeded(SEED))
    assert seen.adapted_return.mean() > seen.meta_return.mean() + 0.01


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


def test_signals_of_the_core_are_those_of_torch() -> None:
    setting = _setting(_config())
    found = forward(setting.theta, core_network(setting.network, torch.float64)).logits[0]
    every = torch.ones(setting.tasks.num_states, setting.tasks.num_actions, dtype=torch.bool)
    table = policy_table(setting.network, setting.parameters, every)
    np.testing.assert_allclose(torch.softmax(torch.from_numpy(found), dim=-1), table, rtol=1e-12)
    assert rollout(table.expand(3, -1, -1) * setting.tasks.enabled, sampler(setting.tasks), 2, seeded(0))


@pytest.mark.parametrize("features", [False, True])
def test_where_nobody_was_nothing_counts(features: bool) -> None:
    """Judgement and curvature on the states that episodes have seen are those on all states."""
    setting = _setting(_config("sampled", 2).model_copy(update={"episodes": 2}))
    if features:
        table = torch.randn(setting.tasks.num_states, 5, generator=seeded(1), dtype=torch.float64)
        network = PolicyNetwork(setting.tasks.num_states, 6, (4,), "softplus", table)
        theta = array_of(flat(random_parameters(network, 0)))
        setting = replace(setting, network=network, theta=theta)
    _, drawn, _ = setting.drawn()
    objective = setting.objective()
    part, known, entries = objective.on_counting_states(drawn)
    assert part.problems[0].tasks.enabled.shape[1] < setting.tasks.num_states
    direction = np.zeros_like(setting.theta)
    direction[entries] = np.random.default_rng(0).standard_normal(len(entries))
    whole = objective.curvature(setting.theta, drawn)(direction)
    found = part.curvature(setting.theta[entries], known)(direction[entries])
    np.testing.assert_allclose(found, whole[entries], rtol=1e-9, atol=1e-12)
    assert np.all(np.delete(whole, entries) == 0)
    moved = setting.theta + 0.01 * direction
    assert part.judge(moved[entries], known) == pytest.approx(objective.judge(moved, drawn), rel=1e-9)
