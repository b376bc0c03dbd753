"""Gradient steps: the written-out loss, weights of bad surprises, the expectation of a step."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from merap.learning import surrogate as module
from merap.learning.config import Baseline
from merap.learning.episodes import Episodes, rollout
from merap.learning.exact import expected_return
from merap.learning.gradient_step import StepRule, behaviour, sampled_step
from merap.learning.policy import Parameters, explore, policy_table, stack_parameters
from merap.learning.surrogate import Surrogate
from merap.learning.tasks import TaskBatch
from merap.learning.threads import one_thread
from tests.support.learning_examples import (
    RING_DISCOUNT,
    random_parameters,
    ring_batch,
    seeded,
    smooth_network,
)

RULE = StepRule(
    discount=RING_DISCOUNT,
    episodes=8,
    baseline="linear",
    ridge=1.0,
    gae_lambda=1.0,
    variance_prior=0.0,
    noise_episodes=20.0,
    exploration=0.0,
)


def _setting(seed: int = 0) -> tuple[TaskBatch, Parameters, Parameters]:
    """Tasks, different parameters for each, and step sizes."""
    tasks = ring_batch()
    sets = [random_parameters(smooth_network(tasks), seed + n) for n in range(tasks.num_tasks)]
    parameters = {name: torch.stack([one[name] for one in sets]) for name in sets[0]}
    sizes = {
        name: torch.tensor(0.1 * (i + 1), dtype=torch.float64) for i, name in enumerate(sorted(parameters))
    }
    return tasks, parameters, sizes


def _sampled(tasks: TaskBatch, parameters: Parameters, rule: StepRule, num_episodes: int) -> Episodes:
    acting = behaviour(smooth_network(tasks), parameters, tasks.enabled, rule)
    return rollout(acting, tasks, num_episodes, seeded(9))


def surrogate(episodes: Episodes, blame: Tensor, rule: StepRule, variance: Tensor | None) -> Surrogate:
    return module.surrogate(episodes, rule.advantage_rule(variance), blame.shape, blame)


def _advantages(episodes: Episodes, num_states: int, rule: StepRule, task: int) -> Tensor:
    """[B, T], normalised over the active steps of one task."""
    advantage = module.advantages(episodes, num_states, rule.advantage_rule(None))[task]
    of_steps = advantage[episodes.active[task]]
    # 1e-3 is the least deviation
    deviation = (of_steps.var(correction=0) + 1e-6).sqrt()
    return (advantage - of_steps.mean()) / deviation


def _loss(
    tasks: TaskBatch, parameters: Parameters, episodes: Episodes, weighted: Tensor, task: int
) -> Tensor:
    """-mean over active steps of log pi(a | s) times what the step weighs, written out for one task."""
    own = {name: value[task] for name, value in parameters.items()}
    table = policy_table(smooth_network(tasks), own, tasks.enabled[task])
    active = episodes.active[task]
    log_probs = table[episodes.state[task][active], episodes.action[task][active]].log()
    return -(log_probs * weighted[active]).mean()


@pytest.mark.parametrize("baseline", ["linear", "time", "none"])
@pytest.mark.parametrize("gae_lambda", [1.0, 0.7])
def test_a_step_descends_the_written_out_loss(baseline: Baseline, gae_lambda: float) -> None:
    tasks, parameters, sizes = _setting()
    rule = replace(RULE, baseline=baseline, gae_lambda=gae_lambda)
    episodes = _sampled(tasks, parameters, rule, rule.episodes)
    stepped = sampled_step(smooth_network(tasks), parameters, sizes, tasks.enabled, episodes, rule, None)
    leaves = {name: value.clone().requires_grad_() for name, value in parameters.items()}
    losses = [
        _loss(tasks, leaves, episodes, _advantages(episodes, tasks.num_states, rule, n), n)
        for n in range(tasks.num_tasks)
    ]
    gradients = torch.autograd.grad(torch.stack(losses).sum(), list(leaves.values()))
    for (name, value), gradient in zip(parameters.items(), gradients, strict=True):
        expected = value - sizes[name] * gradient
        torch.testing.assert_close(stepped.parameters[name], expected, rtol=1e-10, atol=1e-12)
        assert not stepped.parameters[name].requires_grad


def test_a_step_on_other_tasks_changes_nothing() -> None:
    tasks, parameters, sizes = _setting()
    episodes = _sampled(tasks, parameters, RULE, 5)
    network = smooth_network(tasks)
    together = sampled_step(network, parameters, sizes, tasks.enabled, episodes, RULE, None)
    own = Episodes(**{name: getattr(episodes, name)[1:2] for name in ("state", "action", "reward", "active")})
    alone = sampled_step(
        network,
        {name: value[1:2] for name, value in parameters.items()},
        sizes,
        tasks.enabled[1:2],
        own,
        RULE,
        None,
    )
    for name, value in alone.parameters.items():
        torch.testing.assert_close(together.parameters[name][1:2], value, rtol=1e-10, atol=1e-12)


def test_bad_surprises_count_by_how_likely_the_policy_takes_them() -> None:
    # Le Roux et al. 2025: weight 1 for a gain, min(1, pi / mu) for a loss
    tasks, parameters, sizes = _setting()
    rule = replace(RULE, exploration=0.4)
    network = smooth_network(tasks)
    episodes = _sampled(tasks, parameters, rule, rule.episodes)
    stepped = sampled_step(network, parameters, sizes, tasks.enabled, episodes, rule, None)
    table = policy_table(network, parameters, tasks.enabled)
    uniform = tasks.enabled.double() / tasks.enabled.sum(dim=-1, keepdim=True).clamp_min(1)
    ratio = table / (0.6 * table + 0.4 * uniform)
    leaves = {name: value.clone().requires_grad_() for name, value in parameters.items()}
    losses = []
    for n in range(tasks.num_tasks):
        advantage = _advantages(episodes, tasks.num_states, rule, n)
        blame = ratio[n][episodes.state[n], episodes.action[n]].nan_to_num(1.0).clamp_max(1.0)
        assert (blame < 0.9).any()
        assert (blame == 1).any()
        weighted = torch.where(advantage < 0, blame * advantage, advantage)
        losses.append(_loss(tasks, leaves, episodes, weighted, n))
    gradients = torch.autograd.grad(torch.stack(losses).sum(), list(leaves.values()))
    for (name, value), gradient in zip(parameters.items(), gradients, strict=True):
        torch.testing.assert_close(
            stepped.parameters[name], value - sizes[name] * gradient, rtol=1e-10, atol=1e-12
        )


def test_behaviour_is_the_policy_with_the_rules_exploration() -> None:
    tasks, parameters, _ = _setting()
    network = smooth_network(tasks)
    table = policy_table(network, parameters, tasks.enabled)
    assert torch.equal(behaviour(network, parameters, tasks.enabled, RULE), table)
    found = behaviour(network, parameters, tasks.enabled, replace(RULE, exploration=0.25))
    torch.testing.assert_close(found, explore(table, tasks.enabled, 0.25))
    count = tasks.enabled.sum(dim=-1, keepdim=True).expand_as(found)
    assert torch.all(found[tasks.enabled] >= 0.25 / count[tasks.enabled] - 1e-15)


def test_surrogate_by_hand() -> None:
    """One task, two episodes of one step each, no baseline: advantages 3 and 1, mean 2, variance 1.

    Normalised they are 1 and -1 (but for the least deviation), the second is blamed by 0.3 and
    each counts one half.
    """
    state = torch.tensor([[[0], [1]]])
    episodes = Episodes(
        state, torch.tensor([[[1], [0]]]), torch.tensor([[[3.0], [1.0]]]).double(), state >= 0
    )
    rule = replace(RULE, baseline="none")
    blame = torch.full((1, 2, 2), 0.3, dtype=torch.float64)
    found = surrogate(episodes, blame, rule, None)
    expected = torch.tensor([[[0.0, -0.5], [0.15, 0.0]]], dtype=torch.float64) / math.sqrt(1 + 1e-6)
    torch.testing.assert_close(found.gradient, expected, rtol=1e-12, atol=0)
    assert found.variance.tolist() == [1.0]
    # one step per episode
    assert found.scale.tolist() == pytest.approx([1 / math.sqrt(1 + 1e-6)], rel=1e-12)
    # two episodes of variance 1 and six of variance 5 average 4
    with_prior = surrogate(
        episodes, blame, replace(rule, variance_prior=6.0), torch.tensor(5.0, dtype=torch.float64)
    )
    torch.testing.assert_close(with_prior.gradient, expected * math.sqrt((1 + 1e-6) / (4 + 1e-6)))
    assert with_prior.variance.tolist() == [1.0]


def test_equal_rewards_teach_nothing() -> None:
    """The tasks' advantages are rounding errors: they must not become a step."""
    state = torch.zeros(1, 5, 1, dtype=torch.int64)
    reward = torch.full((1, 5, 1), 0.1)
    episodes = Episodes(state, state, reward, state == 0)
    found = surrogate(episodes, torch.ones(1, 2, 2), replace(RULE, baseline="none"), None)
    assert found.gradient.abs().max() < 1e-4
    assert torch.isfinite(found.scale).all()


def test_advantages_are_normalised_over_active_steps() -> None:
    """Per task the gradient's entries are means of weights with mean 0 and variance 1."""
    tasks, parameters, _ = _setting()
    episodes = _sampled(tasks, parameters, RULE, 30)
    for n in range(tasks.num_tasks):
        of_steps = _advantages(episodes, tasks.num_states, RULE, n)[episodes.active[n]]
        assert of_steps.mean().item() == pytest.approx(0, abs=1e-10)
        assert of_steps.std(correction=0).item() == pytest.approx(1, abs=1e-5)
    found = surrogate(episodes, torch.ones(tasks.enabled.shape, dtype=torch.float64), RULE, None)
    assert found.gradient.sum(dim=(1, 2)).abs().max() < 1e-10


def test_the_length_factor() -> None:
    # (1 + n / K) / (1 + n / B) with n = 20, K = 8: 3.5 / (1 + 20 / B)
    rule = replace(RULE, noise_episodes=20.0, episodes=8)
    assert rule.length_factor(8) == 1
    assert rule.length_factor(20) == pytest.approx(1.75)
    assert rule.length_factor(1) == pytest.approx(3.5 / 21)
    assert replace(rule, noise_episodes=0.0).length_factor(1) == 1


def test_a_step_from_other_numbers_of_episodes_has_that_length() -> None:
    tasks, parameters, sizes = _setting()
    network = smooth_network(tasks)
    episodes = _sampled(tasks, parameters, RULE, 20)
    found = sampled_step(network, parameters, sizes, tasks.enabled, episodes, RULE, None)
    plain = replace(RULE, noise_episodes=0.0)
    whole = sampled_step(network, parameters, sizes, tasks.enabled, episodes, plain, None)
    for name, value in parameters.items():
        torch.testing.assert_close(found.parameters[name] - value, 1.75 * (whole.parameters[name] - value))


def test_the_mean_of_sampled_gradients_is_the_gradient_of_the_return() -> None:
    """Without baseline, discount or normalisation: REINFORCE is unbiased (Williams 1992).

    With discount 1 the surrogate of the centred advantages is an affine function of sums over
    episodes; of many episodes it approaches scale times the policy gradient. Each of the entries is
    within 5 standard errors, estimated from 40 groups of episodes: a chance of failure by luck
    below 1e-3 over all of them (Student's t with 39 degrees of freedom).
    """
    tasks, parameters, _ = _setting()
    network = smooth_network(tasks)
    rule = replace(RULE, discount=1.0, baseline="linear")
    table = policy_table(network, parameters, tasks.enabled).requires_grad_()
    (gradient,) = torch.autograd.grad(expected_return(table, replace(tasks, discount=1.0)).sum(), table)
    table = table.detach()
    # the derivative in the logits: log pi's with the softmax taken off
    of_log = gradient * table
    expected = of_log - table * of_log.sum(dim=-1, keepdim=True)
    generator, found = seeded(5), []
    with one_thread():
        for _ in range(40):
            episodes = rollout(table, tasks, 4_000, generator)
            one = surrogate(episodes, torch.ones_like(table), rule, None)
            of_log = -one.gradient / one.scale[:, None, None]
            found.append(of_log - table * of_log.sum(dim=-1, keepdim=True))
    groups = torch.stack(found)
    error = groups.std(dim=0) / math.sqrt(len(found))
    assert (error > 0).sum() > 60
    # 1e-2: the baseline is fitted to the same episodes, which shrinks the mean by about 17 / 4000
    assert torch.all((groups.mean(dim=0) - expected).abs() <= 5 * error + 1e-2 * expected.abs())


def test_copies_of_one_policy_step_apart() -> None:
    tasks, _, sizes = _setting()
    network = smooth_network(tasks)
    stacked = stack_parameters(random_parameters(network, 1), tasks.num_tasks)
    episodes = _sampled(tasks, stacked, RULE, 8)
    stepped = sampled_step(network, stacked, sizes, tasks.enabled, episodes, RULE, None)
    weight = stepped.parameters["layer0.weight"]
    assert weight.shape == stacked["layer0.weight"].shape
    assert not torch.equal(weight[0], weight[1])
