"""What a training run has led to, judged by exact values of adapted policies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.runs.run_folder import RunFolder, read_run
from merap.runs.train import train
from merap.strategies.training_result import MOST_TASKS, TrainingResult, evaluate_training
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, SMALL, trained


@pytest.fixture(scope="module")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


def test_five_updates_teach_little(untrained: RunFolder) -> None:
    found = evaluate_training(untrained)
    assert found.names == untrained.names
    assert found.optimum == pytest.approx([6, 6, 6])  # the goal is eight steps away
    assert (found.adapted <= found.optimum + 1e-9).all()
    assert found.endable == pytest.approx([1, 1, 1])
    assert found.far_from_optimum
    assert found.gain < 0.2


@pytest.mark.slow
def test_the_defaults_teach_enough(tmp_path: Path) -> None:
    found = evaluate_training(train(load_case(ONE_OF_THREE), tmp_path / "run"))
    assert found.gain > 0.8
    assert not found.far_from_optimum
    assert not found.never_ends
    assert (found.ending > 0.5).all()
    assert np.array_equal(found.adapted, evaluate_training(read_run(tmp_path / "run")).adapted)


@pytest.mark.slow
def test_a_policy_that_waits_for_the_horizon_is_seen(tmp_path: Path) -> None:
    """Hazards next to the way: with the default settings the policy learns to stand still."""
    found = evaluate_training(train(load_case(MODELS / "hazard-grid"), tmp_path / "run", TrainingConfig()))
    assert found.never_ends
    assert found.far_from_optimum
    assert found.endable == pytest.approx(np.ones(18), abs=0.2)


@pytest.mark.slow
def test_of_many_tasks_some_are_looked_at(tmp_path: Path) -> None:
    case = load_case(MODELS / "paper-grid" / "rq1-6.yaml")
    run = train(case, tmp_path / "run", SMALL.model_copy(update={"max_tasks": 100, "updates": 1}))
    found = evaluate_training(run)
    assert len(set(found.names)) == MOST_TASKS
    assert set(found.names) <= set(run.names)


def result(
    adapted: float, best: float, random: float, ending: float = 1.0, endable: float = 1.0
) -> TrainingResult:
    parts = (np.array([value]) for value in (adapted, best, random, ending, endable))
    return TrainingResult(("one",), *parts)


def test_the_gain_is_a_part_of_what_is_possible() -> None:
    assert result(2, 6, -2).gain == 0.5
    assert not result(2, 6, -2).far_from_optimum
    assert result(1.9, 6, -2).far_from_optimum
    # nothing can be gained: every policy earns the same
    assert result(-3.5, -3.5, -3.5).gain == 1
    assert not result(-3.5, -3.5, -3.5).far_from_optimum


def test_a_task_that_cannot_be_ended_is_not_missed() -> None:
    assert not result(0, 0, 0, ending=0, endable=0).never_ends
    assert result(0, 1, 0, ending=0, endable=0.5).never_ends
    assert not result(0, 1, 0, ending=0.1, endable=0.5).never_ends
