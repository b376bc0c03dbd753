"""End to end: a served running example, adapted through HTTP by strategies that see nothing else of it."""

from __future__ import annotations

from itertools import repeat
from pathlib import Path

import numpy as np
import pytest

from merap.base.build import model_of
from merap.concerns.case_study import load_case
from merap.errors import InputError
from merap.learning.config import TrainingConfig
from merap.learning.run_folder import RunFolder
from merap.mdp.planning import optimum
from merap.online.belief.space import hypothesis_space
from merap.online.belief.strategy import BeliefStrategy
from merap.online.managed.guarded import GuardedSystem, Retries
from merap.online.managed.managing import Patience, manage
from merap.online.managed.served_dialect import open_served
from merap.online.running import episode, evaluator
from tests.hand_made import grid_combination
from tests.http_servers import FlakyServer, Mishap, free_port, raw_server, served_system, serving
from tests.trained_runs import trained

RUNNING = Path("models/running-example")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    config = TrainingConfig(updates=2, hidden=(4,), episodes=2)
    return trained(tmp_path_factory.mktemp("runs") / "run", config, RUNNING)


def test_a_belief_adapts_through_http_over_a_bad_connection() -> None:
    """A blocked at A, which no model has: after at most 6 episodes within 5 % of the optimum.

    Every tenth request meets with a mishap; with these seeds nothing is left to chance.
    """
    case = load_case(RUNNING)
    met = case.system("met")
    kinds: list[Mishap] = ["none", "lost", "answer lost", "failed", "rubbish"]
    drawn = np.random.default_rng(0).choice(5, 10_000, p=[0.9, *[0.025] * 4])
    server = FlakyServer(served_system(met, seed=1, detect=True), iter(()))
    space = hypothesis_space(case)
    strategy = BeliefStrategy(space, 40, np.random.default_rng(2))
    model = model_of(met)
    with (
        raw_server(server) as url,
        open_served(url, timeout=10, actions=case.actions, variables=space.variable_names) as remote,
    ):
        assert remote.interface.horizon == 40
        server.mishaps = (kinds[index] for index in drawn)
        system = GuardedSystem(remote, retries=Retries(10, 0.0, 0.0))
        for _ in range(6):
            episode(system, strategy)
            strategy.update()
    best = optimum(model, 40)
    assert best - evaluator(model, 40)(strategy.policy()) <= 0.05 * abs(best)


@pytest.mark.parametrize("strategy", ["belief", "gradient"])
def test_a_run_manages_a_served_system_by_any_strategy(run: RunFolder, strategy: str) -> None:
    seen: list[tuple[int, float]] = []
    with serving(run.case.system("met"), detect=True) as url:
        found = manage(
            run,
            url,
            strategy=strategy,
            episodes=2,
            episodes_per_step=2,
            patience=Patience(timeout=30, decision=60, fallback="stop"),
            on_episode=lambda number, earned: seen.append((number, earned)),
        )
    assert seen == list(enumerate(found.returns, 1))
    assert len(found.returns) == 2
    assert found.faults == {}
    assert found.late == 0
    assert found.explanation
    assert found.as_dict()["system"] == url


def test_faults_that_were_mended_are_counted(run: RunFolder) -> None:
    server = FlakyServer(served_system(run.case.system("met"), detect=True), iter(()))
    first: list[Mishap] = ["none"] * 40
    first[20], first[30] = "failed", "rubbish"
    with raw_server(server) as url:
        server.mishaps = iter(first)
        found = manage(run, url, strategy="retrieval", episodes=1)
    assert found.faults == {"failed": 1, "malformed": 1}


def test_a_system_that_is_not_there_is_a_fault(run: RunFolder) -> None:
    found = manage(run, f"http://127.0.0.1:{free_port()}", strategy="belief", episodes=1)
    assert str(found.ended_by).startswith("refused: http://127")
    assert found.returns == ()


def test_what_was_earned_until_a_fault_is_kept(run: RunFolder) -> None:
    """The first episode goes well; soon after every request fails, more often than it is retried."""
    server = FlakyServer(served_system(run.case.system("met"), detect=True), iter(()))

    def fail_from_now_on(number: int, earned: float) -> None:
        server.mishaps = repeat("failed")

    with raw_server(server) as url:
        found = manage(
            run,
            url,
            strategy="retrieval",
            episodes=3,
            patience=Patience(retries=1),
            on_episode=fail_from_now_on,
        )
    assert len(found.returns) == 1
    assert found.faults == {"failed": 2}
    assert found.explanation
    assert str(found.ended_by).startswith("failed: ")
    assert found.as_dict()["ended_by"] == str(found.ended_by)


def test_a_system_of_another_case_is_refused(run: RunFolder) -> None:
    with (
        serving(grid_combination()) as url,
        pytest.raises(InputError, match="has the actions stop"),
    ):
        manage(run, url, strategy="belief", episodes=1)


def test_the_oracle_has_no_model_here(run: RunFolder) -> None:
    with serving(run.case.system("met")) as url, pytest.raises(InputError, match="needs the true model"):
        manage(run, url, strategy="oracle", episodes=1)


def test_a_deadline_needs_a_fallback() -> None:
    with pytest.raises(InputError, match="a deadline for decisions needs a fallback"):
        Patience(decision=1.0)
