"""The strategies `gradient` and `ope` see a system through reset and step alone."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from merap.errors import InputError
from merap.learning.config import TrainingConfig
from merap.learning.episodes import Episodes
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy, step_rule
from merap.learning.models import train_tasks
from merap.learning.policy import PolicyNetwork, initial_parameters, policy_table, stack_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.index import index_of
from merap.mdp.model import TabularMDP
from merap.strategies.evaluation import evaluator, executed, reachable_range
from merap.strategies.gradient import STEP_SIZE, GradientStrategy, untrained
from merap.strategies.protocol import episode
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from tests.support.grid_tasks import DISCOUNT, HORIZON, block, grid_model, grid_task
from tests.support.learning_examples import RING_DISCOUNT, RING_HORIZON, ring_models, seeded
from tests.support.whole_adaptations import adapted


def meta_policy(tasks: TaskBatch, seed: int, exploration: float) -> MetaPolicy:
    """Random parameters and step sizes of 1."""
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, (6,))
    parameters = initial_parameters(network, seeded(seed))
    return MetaPolicy(
        network=network,
        parameters=parameters,
        step_sizes={name: torch.ones_like(value) for name, value in parameters.items()},
        variance=torch.tensor(1.0),
        rule=step_rule(TrainingConfig(exploration=exploration), tasks.discount),
    )


class Recorder:
    """A system that keeps what it was asked and what it said."""

    def __init__(self, model: TabularMDP, horizon: int, seed: int) -> None:
        self.system = SimulatedSystem(model, horizon, np.random.default_rng(seed))
        self.number = {tuple(row): number for number, row in enumerate(model.valuations.tolist())}
        self.episodes: list[list[tuple[int, int, float]]] = []
        self.before = -1

    @property
    def actions(self) -> tuple[str, ...]:
        return self.system.actions

    def reset(self) -> Observation:
        self.episodes.append([])
        return self._seen(self.system.reset())

    def step(self, action: int) -> Observation:
        state = self.before
        seen = self._seen(self.system.step(action))
        self.episodes[-1].append((state, action, seen.reward))
        return seen

    def _seen(self, observation: Observation) -> Observation:
        self.before = self.number[tuple(observation.valuation.tolist())]
        return observation


def as_episodes(recorded: list[list[tuple[int, int, float]]], horizon: int) -> Episodes:
    padded = [[*steps, *[(0, 0, 0.0)] * (horizon - len(steps))] for steps in recorded]
    state, action, reward = torch.tensor([padded], dtype=torch.float64).unbind(dim=-1)
    active = torch.tensor([[[t < len(steps) for t in range(horizon)] for steps in recorded]])
    return Episodes(state.long(), action.long(), reward.float(), active)


@pytest.mark.parametrize("model", ring_models(), ids=["open", "shut", "elsewhere"])
@pytest.mark.parametrize("exploration", [0.0, 0.3])
def test_a_step_is_that_on_the_known_model(model: TabularMDP, exploration: float) -> None:
    tasks = task_batch([model], RING_HORIZON, RING_DISCOUNT)
    assert not tasks.enabled.all()
    meta = meta_policy(tasks, 0, exploration)
    strategy = GradientStrategy(meta, index_of(model), 4, np.random.default_rng(0))
    system = Recorder(model, RING_HORIZON, 0)
    adapted(
        0,
        system,
        strategy,
        evaluator(model, RING_HORIZON),
        reachable_range(model, RING_HORIZON),
        max_episodes=4,
    )
    episodes = as_episodes(system.episodes, RING_HORIZON)
    known = sampled_step(
        meta.network,
        stack_parameters(meta.parameters, 1),
        meta.step_sizes,
        tasks.enabled,
        episodes,
        meta.rule,
        meta.variance,
    )
    with torch.no_grad():
        expected = policy_table(meta.network, known.parameters, tasks.enabled)[0].double().numpy()
    found = executed(model, strategy.policy())[:, :-1]
    reached = model.reachable & ~model.labels["done"]
    np.testing.assert_allclose(found[reached], expected[reached], atol=1e-5)
    start = executed(model, GradientStrategy(meta, index_of(model), 4, np.random.default_rng(0)).policy())
    assert np.abs(found - start[:, :-1]).max() > 1e-3


def with_gap(system: Recorder, strategy: GradientStrategy, gap: set[int]) -> None:
    """An episode in which the steps at some times are not seen."""
    observation, time = system.reset(), 0
    strategy.begin(observation)
    while not observation.last:
        if time - 1 in gap and time not in gap:
            strategy.begin(observation, time, resumed=True)
        seen = time not in gap
        action = strategy.act(observation.enabled) if seen else int(observation.enabled.argmax())
        observation = system.step(action)
        if seen:
            strategy.observe(action, observation)
        time += 1


def test_a_gap_leaves_an_episode_one() -> None:
    """Steps that were not seen are inactive and earn nothing; those after them stay at their times."""
    model = ring_models()[0]
    tasks = task_batch([model], RING_HORIZON, RING_DISCOUNT)
    meta = meta_policy(tasks, 0, 0.3)
    strategy = GradientStrategy(meta, index_of(model), 2, np.random.default_rng(0))
    system, gap = Recorder(model, RING_HORIZON, 0), {1, 2}
    for _ in range(2):
        with_gap(system, strategy, gap)
    assert all(len(steps) > 4 for steps in system.episodes)
    seen = as_episodes(system.episodes, RING_HORIZON)
    kept = seen.active & torch.tensor([time not in gap for time in range(RING_HORIZON)])
    strategy.update()
    known = sampled_step(
        meta.network,
        stack_parameters(meta.parameters, 1),
        meta.step_sizes,
        tasks.enabled,
        Episodes(seen.state, seen.action, seen.reward * kept, kept),
        meta.rule,
        meta.variance,
    )
    for name, value in strategy.parameters.items():
        np.testing.assert_allclose(value, known.parameters[name][0], atol=1e-5)


def test_it_acts_by_the_policy_with_exploration() -> None:
    model = ring_models()[0]
    tasks = task_batch([model], RING_HORIZON, RING_DISCOUNT)
    meta = meta_policy(tasks, 1, 0.3)
    strategy = GradientStrategy(meta, index_of(model), 1, np.random.default_rng(5))
    system = Recorder(model, RING_HORIZON, 0)
    first = system.reset()
    strategy.begin(first)
    assert not first.enabled.all()
    drawn = np.bincount([strategy.act(first.enabled) for _ in range(20_000)], minlength=tasks.num_actions)
    parameters = stack_parameters(meta.parameters, 1)
    with torch.no_grad():
        expected = behaviour(meta.network, parameters, tasks.enabled, meta.rule)[0, system.before].numpy()
    error = 4 * np.sqrt(expected * (1 - expected) / 20_000)
    # Another seed would fail here with a chance of 3e-4: five actions, 6e-5 each.
    assert np.all(np.abs(drawn / 20_000 - expected) <= error)
    assert drawn[~first.enabled].sum() == 0


def test_a_shield_is_obeyed_even_against_the_policy() -> None:
    model = grid_model(grid_task((1, 1)))
    tasks = task_batch([model], HORIZON, DISCOUNT)
    meta = meta_policy(tasks, 0, 0.0)
    certain = {name: torch.zeros_like(value) for name, value in meta.parameters.items()}
    certain["layer1.bias"][1] = 1000.0
    strategy = GradientStrategy(
        MetaPolicy(meta.network, certain, meta.step_sizes, meta.variance, meta.rule),
        index_of(model),
        1,
        np.random.default_rng(0),
    )
    strategy.begin(SimulatedSystem(model, HORIZON, np.random.default_rng(0)).reset())
    assert strategy.act(np.ones(5, dtype=np.bool_)) == 1
    only = np.array([False, False, True, False, True])
    assert {strategy.act(only) for _ in range(100)} == {2, 4}


def test_a_mask_goes_into_the_logits_and_into_the_gradient() -> None:
    model = grid_model(grid_task((1, 1)))
    tasks = task_batch([model], HORIZON, DISCOUNT)
    meta = meta_policy(tasks, 0, 0.0)
    strategy = GradientStrategy(meta, index_of(model), 2, np.random.default_rng(0))
    mask = np.ones((model.num_states, 5), dtype=np.bool_)
    mask[:, 1] = False
    mask[3] = False
    strategy.restrict(mask)
    masked = torch.from_numpy(mask | (np.arange(len(mask)) == 3)[:, np.newaxis]).unsqueeze(0)
    masked = masked & tasks.enabled
    system = Recorder(model, HORIZON, 0)
    episodes = [episode(system, strategy) for _ in range(2)]
    assert len(episodes) == 2
    seen = as_episodes(system.episodes, HORIZON)
    assert not (seen.action[seen.active] == 1).any()
    # What was done before it was masked stays possible in the gradient, which would else be undefined.
    known = sampled_step(
        meta.network,
        stack_parameters(meta.parameters, 1),
        meta.step_sizes,
        masked,
        seen,
        meta.rule,
        meta.variance,
    )
    strategy.update()
    for name, value in strategy.parameters.items():
        torch.testing.assert_close(value, known.parameters[name][0], atol=1e-5, rtol=1e-5)
    assert not strategy.policy()[:3, 1].any()
    # A row that leaves nothing restricts nothing.
    assert (strategy.policy()[3] > 0).all()
    episode(system, strategy)
    strategy.restrict(np.eye(5, dtype=np.bool_)[np.zeros(model.num_states, dtype=np.int64)])
    strategy.update()
    assert all(torch.isfinite(value).all() for value in strategy.parameters.values())


@pytest.mark.parametrize("seed", range(3))
def test_it_adapts(seed: int) -> None:
    goals = block((1, 2), (1, 2))
    tasks = task_batch([grid_model(grid_task(goal)) for goal in goals], HORIZON, DISCOUNT)
    meta = train_tasks(tasks, TrainingConfig(updates=60, seed=seed, learning_rate=0.02))
    met = grid_task((2, 1))
    model = grid_model(met)
    strategy = GradientStrategy(meta, index_of(model), 20, np.random.default_rng(seed))
    assert strategy.explain() == ("the meta policy as before any episode",)
    run = adapted(
        seed,
        SimulatedSystem(model, HORIZON, np.random.default_rng([seed, 1])),
        strategy,
        evaluator(model, HORIZON),
        reachable_range(model, HORIZON),
        max_episodes=240,
    )
    assert len(run.curve) == 13
    assert run.curve[0].expected_return < met.optimum - 1
    assert run.curve[-1].expected_return > met.optimum - 0.3
    steps, returns = strategy.explain()
    assert steps == "12 gradient steps from the meta policy"
    assert "20 episodes" in returns


def test_ope_begins_with_nothing_that_was_learned() -> None:
    model = grid_model(grid_task((1, 1)))
    meta = meta_policy(task_batch([model], HORIZON, DISCOUNT), 0, 0.1)
    start = untrained(meta, np.random.default_rng(0))
    again, other = untrained(meta, np.random.default_rng(0)), untrained(meta, np.random.default_rng(1))
    assert (start.network, start.rule) == (meta.network, meta.rule)
    for name, value in start.parameters.items():
        assert value.shape == meta.parameters[name].shape
        assert (start.step_sizes[name] == STEP_SIZE).all()
        assert torch.equal(value, again.parameters[name])
    weight = start.parameters["layer0.weight"]
    assert not torch.equal(weight, meta.parameters["layer0.weight"])
    assert not torch.equal(weight, other.parameters["layer0.weight"])


def test_ope_keeps_a_running_variance_of_its_own() -> None:
    """Two updates by hand: the first knows no variance, the second that of the first."""
    model = ring_models()[0]
    tasks = task_batch([model], RING_HORIZON, RING_DISCOUNT)
    meta = meta_policy(tasks, 0, 0.0)
    strategy = GradientStrategy(meta, index_of(model), 4, np.random.default_rng(0), trained=False)
    system = Recorder(model, RING_HORIZON, 0)
    limits = evaluator(model, RING_HORIZON), reachable_range(model, RING_HORIZON)
    adapted(0, system, strategy, *limits, max_episodes=8)
    parameters, variance = stack_parameters(meta.parameters, 1), None
    for recorded in (system.episodes[:4], system.episodes[4:]):
        episodes = as_episodes(recorded, RING_HORIZON)
        stepped = sampled_step(
            meta.network, parameters, meta.step_sizes, tasks.enabled, episodes, meta.rule, variance
        )
        parameters, variance = stepped.parameters, stepped.variance.mean()
    with torch.no_grad():
        expected = policy_table(meta.network, parameters, tasks.enabled)[0].double().numpy()
    found = executed(model, strategy.policy())[:, :-1]
    reached = model.reachable & ~model.labels["done"]
    np.testing.assert_allclose(found[reached], expected[reached], atol=1e-5)
    assert strategy.explain()[0] == "2 gradient steps from random parameters"


def test_a_state_that_the_case_lacks_is_refused() -> None:
    model = grid_model(grid_task((1, 1)))
    meta = meta_policy(task_batch([model], HORIZON, DISCOUNT), 0, 0.0)
    strategy = GradientStrategy(meta, index_of(model), 1, np.random.default_rng(0))
    strange = Observation(np.array([9, 0]), np.ones(5, dtype=np.bool_), 0.0, 1.0, truncated=False)
    with pytest.raises(InputError, match=r"\(9, 0\)"):
        strategy.begin(strange)
