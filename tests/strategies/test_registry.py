"""Every strategy by its name, and the baselines that a run keeps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.runs.run_folder import RunFolder
from merap.strategies.evaluation import evaluator
from merap.strategies.problem import AdaptationProblem, adaptation_problem
from merap.strategies.protocol import adaptation_rows
from merap.strategies.registry import (
    STRATEGIES,
    StrategyContext,
    episodes_per_update,
    make_strategy,
    parse_strategy,
)
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from tests.support.grid_tasks import HORIZON
from tests.support.trained_runs import trained


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> AdaptationProblem:
    run = trained(tmp_path_factory.mktemp("runs") / "run")
    return adaptation_problem(run, run.case.system("met"), episodes_per_step=2)


def named(problem: AdaptationProblem, kind: str) -> str:
    return f"{kind}:{problem.context.run.names[0]}" if kind == "pretrained" else kind


class ResetAndStepAlone:
    """A system that has nothing else to look at."""

    def __init__(self, model: TabularMDP, seed: int) -> None:
        system = SimulatedSystem(model, HORIZON, np.random.default_rng(seed))
        self.actions, self.reset, self._step = system.actions, system.reset, system.step
        self.taken: list[int] = []

    def step(self, action: int) -> Observation:
        self.taken.append(action)
        return self._step(action)


@pytest.mark.parametrize("kind", STRATEGIES)
def test_every_strategy_adapts_through_reset_and_step(problem: AdaptationProblem, kind: str) -> None:
    model = problem.truth.model_on(problem.context.index)

    def curve_and_actions() -> tuple[list[float], list[int]]:
        strategy = make_strategy(named(problem, kind), problem.context, np.random.default_rng(1))
        assert strategy.episodes_per_update == episodes_per_update(named(problem, kind), 2)
        system = ResetAndStepAlone(model, 0)
        rows = list(adaptation_rows(system, strategy, evaluator(model, HORIZON), 4))
        assert all(strategy.explain())
        return [row.expected_return for row in rows], system.taken

    curve, taken = curve_and_actions()
    assert len(curve) == 1 + 4 // episodes_per_update(named(problem, kind), 2)
    # between 18 steps for nothing, and the goal eight steps away
    assert all(-9 - 1e-6 <= value <= 6 + 1e-6 for value in curve)
    assert (curve, taken) == curve_and_actions()


def test_belief_refines_what_the_run_has_learned(problem: AdaptationProblem) -> None:
    strategy = make_strategy("belief", problem.context, np.random.default_rng(1))
    # Before any episode the hypotheses differ in what is best, so the plan can be gained on.
    assert "the meta policy after exact gradient steps" in strategy.explain()[-1]


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        (
            "magic",
            "there is no strategy 'magic'; known: gradient, belief, ope, pretrained, joint, retrieval",
        ),
        ("", "there is no strategy ''"),
        ("Gradient", "there is no strategy 'Gradient'"),
        ("joint:all", "the strategy 'joint' takes no argument, got 'joint:all'"),
        ("joint:", "the strategy 'joint' takes no argument, got 'joint:'"),
        ("pretrained", "'pretrained' lacks a combination"),
        ("pretrained:", "'pretrained:' lacks a combination"),
        ("pretrained:nothing", "has no combination 'nothing'"),
        ("pretrained:../../policy", "has no combination '../../policy'"),
    ],
)
def test_what_is_no_strategy_is_refused(problem: AdaptationProblem, name: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        make_strategy(name, problem.context, np.random.default_rng(0))
    assert complaint in str(caught.value)


def test_the_oracle_needs_the_true_model(problem: AdaptationProblem) -> None:
    context = StrategyContext(problem.context.run, HORIZON, 0.95)
    with pytest.raises(InputError, match="'oracle' needs the true model"):
        make_strategy("oracle", context, np.random.default_rng(0))


def test_a_name_is_read_up_to_its_first_colon() -> None:
    assert parse_strategy("pretrained:a.b.c") == ("pretrained", "a.b.c")
    assert parse_strategy("gradient") == ("gradient", "")


def policy_of(run: RunFolder, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    context = StrategyContext(run, HORIZON, 0.95)
    return make_strategy(name, context, np.random.default_rng(0)).policy()


@pytest.mark.parametrize("kind", ["joint", "pretrained"])
def test_a_baseline_is_learned_once(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run = trained(tmp_path / "run")
    name = f"{kind}:{run.names[1]}" if kind == "pretrained" else kind
    first = policy_of(run, name)
    file = next((run.path / "baselines").rglob("*.safetensors"))
    content = file.read_bytes()
    monkeypatch.setattr(torch.optim.Adam, "step", _no_learning)
    np.testing.assert_array_equal(policy_of(run, name), first)
    assert file.read_bytes() == content
    assert [path.name for path in (run.path / "baselines").rglob("*") if path.is_file()] == [file.name]


def _no_learning(*_: object, **__: object) -> None:
    raise AssertionError("a policy is learned anew")


def test_damaged_stale_and_foreign_baselines_are_refused(problem: AdaptationProblem) -> None:
    run = problem.context.run
    policy_of(run, "joint")
    file = run.path / "baselines" / "joint.safetensors"
    content = file.read_bytes()
    with safe_open(file, framework="pt") as opened:
        recipe = json.loads(opened.metadata()["recipe"])
        tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118

    def complaint() -> str:
        with pytest.raises(InputError) as caught:
            policy_of(run, "joint")
        message = str(caught.value)
        assert message.startswith(str(file))
        assert "remove it to learn the policy anew" in message
        assert "\n" not in message
        return message

    try:
        file.write_bytes(content[:100])
        assert "can't be read" in complaint()
        save_file(tensors, file, {"recipe": json.dumps({**recipe, "updates": 7})})
        assert "updates 7, not 200" in complaint()
        save_file(tensors, file, {"recipe": json.dumps({**recipe, "case": "00"})})
        assert "case '00'" in complaint()
        save_file(tensors, file, {"recipe": "{"})
        assert "can't be read" in complaint()
        save_file(tensors, file)
        assert "it says not what" in complaint()
        wider = {**tensors, "layer0.bias": torch.zeros(9)}
        save_file(wider, file, {"recipe": json.dumps(recipe)})
        assert "another shape" in complaint()
    finally:
        file.write_bytes(content)
    policy_of(run, "joint")
