"""Training runs: seeds, interruptions, and what an update does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest
import torch

from merap.errors import ModelError
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy
from merap.learning.models import train_tasks
from merap.learning.progress import UpdateMetrics
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.threads import one_thread
from merap.learning.training import initial_state, meta_policy, outcome, policy_network, updates
from merap.runs import train as training_run
from merap.runs.checkpoint import CHECKPOINT_FILE
from merap.runs.run_folder import read_run
from merap.runs.train import begin_run, resume, train_run
from tests.support.grid_tasks import DISCOUNT, HORIZON, grid_model, grid_task
from tests.support.trained_runs import (
    SMALL,
    InterruptionError,
    checkpoint_update,
    contents,
    grid_case,
    interrupt_at,
    trained,
    what_was_learned,
)

# Two tasks of five are drawn for an update, so that the generator matters there too.
CONFIG = SMALL.model_copy(update={"tasks_per_update": 2})
INTERRUPTED_AT = 3


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    with one_thread():
        yield


@pytest.fixture(scope="module")
def tasks() -> TaskBatch:
    goals = [(0, 2), (2, 0), (1, 1), (3, 0), (0, 3)]
    return task_batch([grid_model(grid_task(goal)) for goal in goals], HORIZON, DISCOUNT)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp("runs") / "undisturbed", CONFIG).path


def same(one: MetaPolicy, other: MetaPolicy) -> bool:
    return all(
        torch.equal(one.parameters[name], other.parameters[name])
        and torch.equal(one.step_sizes[name], other.step_sizes[name])
        for name in one.parameters
    ) and torch.equal(one.variance, other.variance)


def test_a_seed_gives_the_same_bits_and_another_seed_others(tasks: TaskBatch) -> None:
    first, again = train_tasks(tasks, CONFIG), train_tasks(tasks, CONFIG)
    other = train_tasks(tasks, CONFIG.model_copy(update={"seed": 1}))
    assert same(first, again)
    for name in first.parameters:
        assert not torch.equal(first.parameters[name], other.parameters[name])


def test_a_seed_gives_the_same_run_folder(undisturbed: Path, tmp_path: Path) -> None:
    again = contents(trained(tmp_path / "again", CONFIG).path)
    before = contents(undisturbed)
    assert again.pop("times.csv") != before.pop("times.csv")
    assert again == before


def test_the_global_generator_is_neither_used_nor_changed(tasks: TaskBatch) -> None:
    torch.manual_seed(0)
    before = torch.random.get_rng_state()
    first = train_tasks(tasks, CONFIG)
    assert torch.equal(torch.random.get_rng_state(), before)
    torch.manual_seed(1)
    assert same(train_tasks(tasks, CONFIG), first)


def test_the_number_of_threads_changes_nothing(tasks: TaskBatch) -> None:
    first = train_tasks(tasks, CONFIG)
    torch.set_num_threads(2)
    assert same(train_tasks(tasks, CONFIG), first)


@pytest.mark.parametrize("every_update", [False, True], ids=["before a checkpoint", "after checkpoints"])
def test_an_interrupted_run_goes_on_bit_for_bit(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every_update: bool
) -> None:
    # In the first case none falls due in these few milliseconds.
    monkeypatch.setattr(training_run, "SECONDS_BETWEEN_CHECKPOINTS", -1.0 if every_update else 3600.0)
    run = begin_run(tmp_path / "run", grid_case(), CONFIG)
    with pytest.raises(InterruptionError):
        train_run(run, interrupt_at(INTERRUPTED_AT))
    # The third update was done but not written yet.
    assert checkpoint_update(run.path) == (INTERRUPTED_AT - 1 if every_update else 0)
    assert (run.path / CHECKPOINT_FILE).exists() is every_update
    seen: list[int] = []
    resume(run.path, lambda metrics: seen.append(metrics.update))
    assert seen == ([3, 4, 5] if every_update else [1, 2, 3, 4, 5])
    assert what_was_learned(run.path) == what_was_learned(undisturbed)


def test_a_run_may_be_interrupted_at_every_update(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_run, "SECONDS_BETWEEN_CHECKPOINTS", -1.0)
    run = begin_run(tmp_path / "run", grid_case(), CONFIG)
    for update in range(2, CONFIG.updates + 1):
        with pytest.raises(InterruptionError):
            train_run(read_run(run.path), interrupt_at(update))
    resume(run.path)
    assert what_was_learned(run.path) == what_was_learned(undisturbed)


def test_to_resume_a_finished_run_changes_nothing(tmp_path: Path) -> None:
    run = trained(tmp_path / "run", CONFIG)
    before = contents(run.path)
    seen: list[UpdateMetrics] = []
    resume(run.path, seen.append)
    assert seen == []
    assert contents(run.path) == before


def test_a_state_goes_on_where_it_is(tasks: TaskBatch) -> None:
    state = initial_state(policy_network(tasks, CONFIG), CONFIG)
    first = list(islice(updates(tasks, CONFIG, state), 2))
    assert state.update == 2
    second = list(updates(tasks, CONFIG, state))
    assert [row.update for row in (*first, *second)] == [1, 2, 3, 4, 5]
    assert list(updates(tasks, CONFIG, state)) == []


def test_both_rates_fall_along_a_cosine(tasks: TaskBatch) -> None:
    config = TrainingConfig(
        updates=4, hidden=(4,), episodes=2, learning_rate=0.2, step_size_learning_rate=0.4
    )
    state = initial_state(policy_network(tasks, config), config)
    rates = [(metrics.learning_rate, state.optimizer.rates[1]) for metrics in updates(tasks, config, state)]
    # Down to a tenth: 0.1 + 0.9 (1 + cos(pi k / 4)) / 2 for k = 0..3.
    parts = [1, 0.1 + 0.45 * (1 + math.sqrt(0.5)), 0.55, 0.1 + 0.45 * (1 - math.sqrt(0.5))]
    assert rates == [pytest.approx((0.2 * part, 0.4 * part)) for part in parts]


def test_step_sizes_stay_where_they_begin_if_their_rate_is_0(tasks: TaskBatch) -> None:
    config = CONFIG.model_copy(update={"step_size": 0.25, "step_size_learning_rate": 0.0})
    policy = train_tasks(tasks, config)
    for size in policy.step_sizes.values():
        torch.testing.assert_close(size, torch.full_like(size, 0.25))
    learned = train_tasks(tasks, CONFIG).step_sizes
    assert any(not torch.allclose(size, torch.full_like(size, 0.5)) for size in learned.values())


def test_what_an_update_shows_is_within_its_bounds(tasks: TaskBatch) -> None:
    rows: list[UpdateMetrics] = []
    train_tasks(tasks, CONFIG, rows.append)
    # Never better than 10 at once, never worse than -0.5 a step for ever.
    for row in rows:
        assert -0.5 / (1 - DISCOUNT) <= row.meta_return <= 10
        assert -0.5 / (1 - DISCOUNT) <= row.adapted_return <= 10
        assert 0 <= row.entropy <= math.log(5)  # five actions
        assert row.gradient_norm > 0
        assert row.seconds > 0
    # Small random weights are nearly uniform.
    assert rows[0].entropy > 0.9 * math.log(5)


def test_training_raises_what_it_maximises(tasks: TaskBatch) -> None:
    """Without entropy the only objective is the adapted return: -4.4 before, -2.7 after (measured)."""
    rows: list[UpdateMetrics] = []
    config = TrainingConfig(updates=30, hidden=(16,), entropy=0.0)
    train_tasks(tasks, config, rows.append)
    assert rows[-1].adapted_return > rows[0].adapted_return + 1


OUTER: list[dict[str, object]] = [
    {"outer": "sgd", "learning_rate": 0.5},
    {"outer": "adam", "outer_repeats": 3},
    {"outer": "trpo"},
    {"estimator": "sampled", "outer": "adam"},
    {"estimator": "sampled", "outer": "trpo", "outer_repeats": 2},
    {"inner_steps": 2, "span": "infinite"},
    {"observation": "factored"},
]


@pytest.mark.parametrize("settings", OUTER, ids=str)
def test_every_way_of_learning_improves_the_adapted_return(
    tasks: TaskBatch, settings: dict[str, object]
) -> None:
    """From -4.4 or so; measured gains of 40 updates are between 0.5 and 3."""
    rows: list[UpdateMetrics] = []
    given = {"updates": 40, "hidden": (16,), "entropy": 0.0, "episodes": 35, **settings}
    train_tasks(tasks, TrainingConfig.model_validate(given), rows.append)
    first, last = (sum(row.adapted_return for row in part) / 5 for part in (rows[:5], rows[-5:]))
    assert last > first + 0.25, (first, last)


def test_a_trust_region_bounds_every_step(tasks: TaskBatch) -> None:
    rows: list[UpdateMetrics] = []
    config = TrainingConfig(estimator="sampled", updates=10, hidden=(8,), max_kl=0.003)
    train_tasks(tasks, config, rows.append)
    for row in rows:
        assert 0 <= row.kl <= 0.003
        assert row.step_length == 0 or row.kl > 0
        assert math.isnan(row.learning_rate)
    assert sum(row.step_length > 0 for row in rows) >= 8


def test_repeated_outer_steps_go_further(tasks: TaskBatch) -> None:
    """The paper's other reading of RQ2: the outer gradient of one update, taken several times."""
    drawn = []
    for repeats in (1, 3):
        config = CONFIG.model_copy(update={"updates": 1, "outer_repeats": repeats, "outer": "sgd"})
        start = initial_state(policy_network(tasks, config), config).theta
        state = initial_state(policy_network(tasks, config), config)
        list(updates(tasks, config, state))
        drawn.append(float((state.theta - start).norm()))
    assert drawn[1] > 2 * drawn[0]


def test_training_stops_on_a_plateau(tasks: TaskBatch) -> None:
    config = CONFIG.model_copy(
        update={"updates": 200, "patience": 15, "learning_rate": 1e-12, "step_size_learning_rate": 0.0}
    )
    state = initial_state(policy_network(tasks, config), config)
    rows = list(updates(tasks, config, state))
    assert 25 <= len(rows) < 200
    found = outcome(config, state)
    assert found.stopped
    assert found.updates == found.kept == len(rows)
    assert list(updates(tasks, config, state)) == []


def test_a_collapsed_run_keeps_its_best_policy(tasks: TaskBatch) -> None:
    """30 good updates, then a learning rate that throws the policy away."""
    config = TrainingConfig(updates=60, hidden=(16,), entropy=0.0, final_learning_rate=1.0)
    state = initial_state(policy_network(tasks, config), config)
    good = list(islice(updates(tasks, config, state), 30))
    assert not outcome(config, state).collapsed
    state.theta.copy_(20 * torch.randn(state.theta.shape, generator=torch.Generator().manual_seed(1)))
    frozen = config.model_copy(update={"learning_rate": 1e-9, "step_size_learning_rate": 0.0})
    list(updates(tasks, frozen, state))
    found = outcome(config, state)
    assert found.collapsed
    assert found.kept <= 40
    assert found.best_score > found.last_score + 0.5
    kept = meta_policy(tasks, config, state)
    assert state.best is not None
    assert torch.equal(torch.cat([value.flatten() for value in kept.parameters.values()]), state.best.theta)
    assert good[-1].adapted_return > found.last_score


def test_a_gradient_that_is_no_number_ends_training(tasks: TaskBatch) -> None:
    state = initial_state(policy_network(tasks, CONFIG), CONFIG)
    state.theta.fill_(math.nan)
    with pytest.raises(ModelError, match="the gradient of update 1 is no number; a lower learning rate"):
        list(updates(tasks, CONFIG, state))


def test_then_the_best_policy_is_kept(tasks: TaskBatch) -> None:
    config = CONFIG.model_copy(update={"updates": 30})
    state = initial_state(policy_network(tasks, config), config)
    list(islice(updates(tasks, config, state), 15))
    best = state.best
    assert best is not None
    state.theta.fill_(math.nan)
    assert list(updates(tasks, config, state)) == []
    found = outcome(config, state)
    assert (found.collapsed, found.stopped, found.updates) == (True, True, 15)
    kept = meta_policy(tasks, config, state).parameters
    assert torch.equal(torch.cat([value.flatten() for value in kept.values()]), best.theta)


@pytest.mark.parametrize("outer", ["sgd", "trpo"])
def test_other_optimizers_go_on_bit_for_bit_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outer: str
) -> None:
    config = SMALL.model_copy(update={"outer": outer, "updates": 14, "patience": 100})
    whole = trained(tmp_path / "whole", config)
    monkeypatch.setattr(training_run, "SECONDS_BETWEEN_CHECKPOINTS", -1.0)
    run = begin_run(tmp_path / "run", grid_case(), config)
    with pytest.raises(InterruptionError):
        train_run(run, interrupt_at(12))
    resume(run.path)
    assert what_was_learned(run.path) == what_was_learned(whole.path)
