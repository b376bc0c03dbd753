"""The outer objective: its value, and its gradient against finite differences in double precision."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import pytest
import torch

from merap.learning import objective
from merap.learning.config import Activation, Estimator, Span, TrainingConfig
from merap.learning.episodes import drawn_episodes
from merap.learning.exact import expected_return
from merap.learning.gradient_step import StepRule, sampled_step
from merap.learning.meta import step_rule
from merap.learning.policy import PolicyNetwork, flat, policy_table, stack_parameters
from tests.support.learning_examples import (
    RING_DISCOUNT,
    RING_HORIZON,
    random_parameters,
    seeded,
    with_horizon,
)
from tests.support.outer_objectives import (
    LOG_SIZES,
    SEED,
    VARIANCE,
    Order,
    Setting,
    make_config,
    make_setting,
    relative_error,
    slopes_of,
)

CASES = [
    *product(("exact", "sampled"), (1, 3), ("softplus", "tanh"), ("horizon",)),
    *product(("exact",), (1, 3), ("softplus",), ("infinite",)),
]


@pytest.mark.parametrize(("estimator", "inner_steps", "activation", "span"), CASES)
def test_the_meta_gradient_is_the_slope_with_what_was_drawn_held(
    estimator: Estimator, inner_steps: int, activation: Activation, span: Span
) -> None:
    """Second order, in theta and log alpha: episodes, their noise and old log-probabilities are fixed."""
    setting = make_setting(make_config(estimator, inner_steps, activation=activation, span=span))
    gradient, drawn, _ = setting.drawn()
    in_theta = slopes_of(lambda theta: setting.worth(theta, LOG_SIZES, drawn), setting.theta)
    in_sizes = slopes_of(lambda log: setting.worth(setting.theta, log, drawn), LOG_SIZES)
    assert relative_error(gradient.theta, in_theta) < 1e-6
    assert relative_error(gradient.sizes, in_sizes) < 1e-6
    again = setting.objective.gradient(setting.theta, LOG_SIZES, drawn)
    torch.testing.assert_close(again.theta, gradient.theta, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(again.sizes, gradient.sizes, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_repeated_gradients_are_slopes_elsewhere(estimator: Estimator) -> None:
    """As outer_repeats takes them: away from where episodes were drawn, ratios are no longer 1."""
    setting = make_setting(make_config(estimator, 2))
    _, drawn, _ = setting.drawn()
    elsewhere = setting.theta + 0.05 * torch.randn(setting.theta.shape, generator=seeded(3)).double()
    found = setting.objective.gradient(elsewhere, LOG_SIZES, drawn)
    slopes = slopes_of(lambda theta: setting.worth(theta, LOG_SIZES, drawn), elsewhere)
    assert relative_error(found.theta, slopes) < 1e-6


@pytest.mark.parametrize("inner_steps", [1, 3])
@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_first_order_is_the_outer_gradient_at_the_adapted_parameters(
    estimator: Estimator, inner_steps: int
) -> None:
    """And no gradient of the adapted worth."""
    setting = make_setting(make_config(estimator, inner_steps, order=1))
    gradient, drawn, _ = setting.drawn()
    leaves = {name: value.requires_grad_() for name, value in setting.adapted(drawn).items()}
    table = policy_table(setting.network, leaves, setting.tasks.enabled)
    worth = drawn[0].worth
    earned = expected_return(table, setting.tasks) if worth is None else (worth * table).sum(dim=(1, 2))
    outer = torch.autograd.grad(earned.sum() / 3, tuple(leaves.values()))
    expected = torch.cat([part.sum(dim=0).flatten() for part in outer])
    torch.testing.assert_close(gradient.theta, expected, rtol=1e-10, atol=1e-12)
    slopes = slopes_of(lambda theta: setting.worth(theta, LOG_SIZES, drawn), setting.theta)
    assert relative_error(gradient.theta, slopes) > 0.01


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_curvature_is_that_of_the_divergence(estimator: Estimator, order: Order) -> None:
    """KL(theta + h u) = h^2 u' F u / 2 + O(h^3); both signs of h cancel the odd term."""
    config = make_config(estimator, 2, order).model_copy(update={"outer": "trpo"})
    setting = make_setting(config)
    _, drawn, _ = setting.drawn()
    whole = setting.objective
    product_with = whole.curvature(setting.theta, LOG_SIZES, drawn)
    assert whole.judge(setting.theta, LOG_SIZES, drawn)[1] == pytest.approx(0, abs=1e-12)
    generator = seeded(5)
    for _ in range(5):
        direction = torch.randn(setting.theta.shape, generator=generator, dtype=torch.float64)
        if order == 2:
            step = 1e-4 * direction
            moved = [setting.theta + sign * step for sign in (1, -1)]
            both = sum(whole.judge(theta, LOG_SIZES, drawn)[1] for theta in moved)
            assert direction @ product_with(direction) == pytest.approx(both / 1e-8, rel=1e-4)
        other = torch.randn(setting.theta.shape, generator=generator, dtype=torch.float64)
        assert other @ product_with(direction) == pytest.approx((direction @ product_with(other)).item())


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_an_inner_step_goes_where_the_online_step_goes(estimator: Estimator) -> None:
    """Expectation and noise add up to the step from the same episodes (`gradient_step`)."""
    setting = make_setting(make_config(estimator))
    _, drawn, _ = setting.drawn()
    found = setting.adapted(drawn)
    rule = step_rule(setting.config, RING_DISCOUNT)
    start = stack_parameters(setting.parameters, 3)
    draws = torch.rand(
        (3, drawn_rounds(setting), 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64
    )
    table = policy_table(setting.network, start, setting.tasks.enabled)
    episodes = drawn_episodes(table, setting.tasks, draws[:, 0])
    sizes = dict(zip(start, LOG_SIZES.exp(), strict=True))
    rule = StepRule(**{**vars(rule), "exploration": 0.0})
    stepped = sampled_step(setting.network, start, sizes, setting.tasks.enabled, episodes, rule, VARIANCE)
    torch.testing.assert_close(found, stepped.parameters, rtol=1e-9, atol=1e-11)


def drawn_rounds(setting: Setting) -> int:
    """Episodes are drawn for every inner step; by the sampled estimator for the adapted policies too."""
    return setting.config.inner_steps + (setting.config.estimator == "sampled")


def test_without_noise_a_step_follows_the_gradient_of_the_exact_return() -> None:
    setting = make_setting(make_config().model_copy(update={"sampling_noise": False}))
    _, drawn, _ = setting.drawn()
    leaves = {
        name: value.clone().requires_grad_()
        for name, value in stack_parameters(setting.parameters, 3).items()
    }
    table = policy_table(setting.network, leaves, setting.tasks.enabled)
    returns = expected_return(table, setting.tasks)
    slopes = torch.autograd.grad(returns.sum(), tuple(leaves.values()))
    scale = drawn[0].losses[0].scale
    assert scale is not None
    for value, before, slope, size in zip(
        setting.adapted(drawn).values(), leaves.values(), slopes, LOG_SIZES.exp(), strict=True
    ):
        expected = before.detach() + size * scale.view(3, *[1] * (slope.dim() - 1)) * slope
        torch.testing.assert_close(value, expected, rtol=1e-10, atol=1e-12)


def test_what_is_seen_is_what_the_policies_earn() -> None:
    setting = make_setting(make_config(inner_steps=2))
    _, drawn, seen = setting.drawn()
    start = stack_parameters(setting.parameters, 3)
    table = policy_table(setting.network, start, setting.tasks.enabled)
    torch.testing.assert_close(seen.meta_return, expected_return(table, setting.tasks), rtol=1e-12, atol=0)
    adapted = policy_table(setting.network, setting.adapted(drawn), setting.tasks.enabled)
    torch.testing.assert_close(
        seen.adapted_return, expected_return(adapted, setting.tasks), rtol=1e-10, atol=0
    )
    worth = setting.objective.judge(setting.theta, LOG_SIZES, drawn)[0]
    assert worth == pytest.approx(seen.adapted_return.mean())


def test_sampled_returns_are_those_of_the_episodes() -> None:
    setting = make_setting(make_config("sampled"))
    _, _, seen = setting.drawn()
    start = stack_parameters(setting.parameters, 3)
    draws = torch.rand((3, 2, 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64)
    table = policy_table(setting.network, start, setting.tasks.enabled)
    reward = drawn_episodes(table, setting.tasks, draws[:, 0]).reward
    discounts = RING_DISCOUNT ** torch.arange(RING_HORIZON, dtype=torch.float64)
    torch.testing.assert_close(seen.meta_return, (reward @ discounts).mean(dim=1), rtol=1e-12, atol=0)


def test_entropy_and_its_gradient_are_those_over_the_steps_of_the_first_episodes() -> None:
    setting = make_setting(make_config(inner_steps=3))
    _, drawn, seen = setting.drawn()
    leaves = {name: value.clone().requires_grad_() for name, value in setting.parameters.items()}
    table = policy_table(setting.network, leaves, setting.tasks.enabled)
    draws = torch.rand((3, 3, 12, RING_HORIZON + 1), generator=seeded(SEED), dtype=torch.float64)
    episodes = drawn_episodes(table, setting.tasks, draws[:, 0])
    entropies = -(table * table.clamp_min(1e-300).log()).sum(dim=-1)
    of_tasks = [
        entropies[n, episodes.state[n][episodes.active[n]]].mean() for n in range(setting.tasks.num_tasks)
    ]
    mean = torch.stack(of_tasks).mean()
    assert seen.entropy.mean().item() == pytest.approx(mean.item(), rel=1e-12)
    slopes = torch.autograd.grad(mean, list(leaves.values()))
    found = setting.objective.entropy_gradient(setting.theta, drawn)
    torch.testing.assert_close(found, torch.cat([slope.flatten() for slope in slopes]), rtol=1e-9, atol=1e-12)


def test_the_entropy_of_the_uniform_policy() -> None:
    """The first step of the ring has 4 actions at location S or A: the entropy is log 4."""
    setting = make_setting(make_config())
    tasks = with_horizon(setting.tasks, 1)
    uniform = Setting(setting.config, tasks, setting.network, torch.zeros_like(setting.theta))
    assert set(tasks.enabled[tasks.initial > 0].sum(dim=-1).tolist()) == {4}
    assert uniform.drawn()[2].entropy.tolist() == pytest.approx([math.log(4)] * 3, rel=1e-12)


@pytest.mark.parametrize("estimator", ["exact", "sampled"])
def test_ranges_and_threads_change_nothing_but_rounding(
    monkeypatch: pytest.MonkeyPatch, estimator: Estimator
) -> None:
    """20 tasks in three ranges: each task's share is the same, and sums are in order."""
    config = make_config(estimator).model_copy(update={"outer": "trpo"})
    setting = make_setting(config)
    many = Setting(config, setting.tasks[torch.arange(20) % 3], setting.network, setting.theta)
    whole, drawn, seen = many.drawn()
    direction = torch.randn(setting.theta.shape, generator=seeded(1), dtype=torch.float64)
    product_with = many.objective.curvature(setting.theta, LOG_SIZES, drawn)(direction)
    monkeypatch.setattr(objective, "_RANGE_NUMEL", 8 * setting.tasks.num_states * 6)
    assert [loop.num_tasks for loop in many.objective.loops] == [6, 7, 7]
    before = torch.get_num_threads()
    found = []
    for threads in (1, 2, 4):
        torch.set_num_threads(threads)
        found.append(many.drawn())
    torch.set_num_threads(before)
    for gradient, parts, other in found:
        assert torch.equal(found[0][0].theta, gradient.theta)
        assert torch.equal(found[0][0].sizes, gradient.sizes)
        assert relative_error(gradient.theta, whole.theta) < 1e-12
        torch.testing.assert_close(other.adapted_return, seen.adapted_return, rtol=1e-12, atol=0)
        in_ranges = many.objective.curvature(setting.theta, LOG_SIZES, parts)(direction)
        assert relative_error(in_ranges, product_with) < 1e-10


def test_a_short_step_from_many_episodes_improves_the_return() -> None:
    config = make_config().model_copy(update={"episodes": 2_000})
    setting = make_setting(config)
    rule = step_rule(config, RING_DISCOUNT).advantage_rule(VARIANCE)
    _, seen, _ = setting.objective.draw(setting.theta, LOG_SIZES - 2, rule, config, seeded(SEED))
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


@pytest.mark.parametrize("features", [False, True])
def test_where_nobody_was_nothing_counts(features: bool) -> None:
    """Gradient, worth and curvature on the states that episodes have seen are those on all states."""
    setting = make_setting(make_config("sampled", 2).model_copy(update={"episodes": 2}))
    if features:
        table = torch.randn(setting.tasks.num_states, 5, generator=seeded(1), dtype=torch.float64)
        network = PolicyNetwork(setting.tasks.num_states, 6, (4,), "softplus", table)
        setting = replace(setting, network=network, theta=flat(random_parameters(network, 0)))
    gradient, drawn, _ = setting.drawn()
    whole = setting.objective
    part, known = whole.on_counting_states(drawn)
    assert part.loops[0].enabled.shape[1] < setting.tasks.num_states
    theta, counting = setting.theta, part.counting
    found = part.gradient(counting(theta), LOG_SIZES, known)
    nothing = torch.zeros_like(theta)
    torch.testing.assert_close(part.spread(found.theta, nothing), gradient.theta, rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(found.sizes, gradient.sizes, rtol=1e-9, atol=1e-12)
    entropy = part.spread(part.entropy_gradient(counting(theta), known), nothing)
    torch.testing.assert_close(entropy, whole.entropy_gradient(theta, drawn), rtol=1e-9, atol=1e-12)
    drawn_direction = torch.randn(theta.shape, generator=seeded(0), dtype=torch.float64)
    direction = part.spread(counting(drawn_direction), nothing)
    expected = whole.curvature(theta, LOG_SIZES, drawn)(direction)
    product_with = part.curvature(counting(theta), LOG_SIZES, known)(counting(direction))
    torch.testing.assert_close(part.spread(product_with, nothing), expected, rtol=1e-9, atol=1e-12)
    moved = theta + 0.01 * direction
    judged = whole.judge(moved, LOG_SIZES, drawn)
    assert part.judge(counting(moved), LOG_SIZES, known) == pytest.approx(judged, rel=1e-9)
