"""Every strategy on families that are no map: processes without a space, and PRISM text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.errors import InputError, MerapWarning
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.mdp.planning import optimum
from merap.runs.run_folder import RunFolder, read_base
from merap.runs.train import train
from merap.strategies.adaptation import adapt
from merap.strategies.problem import Conditions
from merap.systems.slip import slipping_model
from tests.support.case_examples import write_case
from tests.support.process_cases import SERVICE
from tests.support.small_families import LAMPS, LAMPS_CASE, RAIL, RAIL_CASE

LEARNING = TrainingConfig(updates=3, hidden=(8,), episodes=5)
# The system that is met has parameters that no member has, and a horizon of its own.
ONLINE = """\
online:
  met: {environment: {up: 0.3, down: 0.15}, capability: slow, objective: {w_time: 2}, horizon: 12}
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("service")
    return train(load_case(write_case(folder, SERVICE + ONLINE)), folder / "run", LEARNING)


@pytest.fixture(scope="module")
def lamps(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("lamps")
    (folder / "lamps.prism").write_text(LAMPS, encoding="utf-8")
    return train(load_case(write_case(folder, LAMPS_CASE)), folder / "run", LEARNING)


@pytest.mark.parametrize("strategy", ["gradient", "oracle", "retrieval", "joint", "ope", "pretrained"])
@pytest.mark.parametrize("family", ["service", "lamps"])
def test_every_strategy_adapts_to_a_system_outside_the_base(
    family: str, strategy: str, request: pytest.FixtureRequest
) -> None:
    """It is scored on the true model over its own horizon: no policy is worth more than the optimum there."""
    run: RunFolder = request.getfixturevalue(family)
    name = f"pretrained:{run.names[0]}" if strategy == "pretrained" else strategy
    found = adapt(run, "met", strategy=name, steps=2, episodes_per_step=3, conditions=Conditions(slip=0.1))
    met = run.case.system("met")
    whole = slipping_model(met, 0.1)
    best = optimum(whole, met.objective.horizon)
    assert found.reachable.optimum == pytest.approx(best)
    values = [row.expected_return for row in found.runs[0].curve]
    assert all(found.reachable.worst - 1e-9 <= value <= best + 1e-9 for value in values)
    if strategy == "oracle":
        assert values == [pytest.approx(best)] * 3


def test_who_names_no_strategy_is_told_which_it_is(service: RunFolder) -> None:
    with pytest.warns(MerapWarning, match="no belief is kept over this family so far, since load changes"):
        found = adapt(service, "met", steps=1, episodes_per_step=2)
    assert found.strategy == "gradient"


@pytest.mark.parametrize("family", ["service", "lamps"])
def test_belief_and_shield_are_refused_in_one_line(family: str, request: pytest.FixtureRequest) -> None:
    run: RunFolder = request.getfixturevalue(family)
    why = {"service": "load changes beside location and mode", "lamps": "it is PRISM text"}[family]
    message = f"^{family}: no belief is kept over this family so far, since {why}$"
    with pytest.raises(InputError, match=message):
        adapt(run, "met", strategy="belief", steps=1)
    with pytest.raises(InputError, match=message):
        adapt(run, "met", strategy="gradient", steps=1, shield=0.1)


def test_policies_have_rows_for_states_that_no_member_has(tmp_path: Path) -> None:
    """Rails of the base end at 2 and 4, the system's at 7: it is at 5 and 6 amid its task."""
    (tmp_path / "rail.prism").write_text(RAIL, encoding="utf-8")
    run = train(load_case(write_case(tmp_path, RAIL_CASE)), tmp_path / "run", LEARNING)
    found = adapt(run, "met", strategy="gradient", steps=1, episodes_per_step=2)
    known = {tuple(row) for row in read_base(run).index.valuations.tolist()}
    beyond = [number for number, row in enumerate(found.model.valuations.tolist()) if tuple(row) not in known]
    assert len(beyond) > 0
    reached = [number for number in beyond if found.model.reachable[number]]
    np.testing.assert_allclose(found.before[reached].sum(axis=-1), 1)
    np.testing.assert_allclose(found.after[reached].sum(axis=-1), 1)
    # seven pushes, each of which takes hold with 0.8: 8.75 on average; 30 are nearly always enough
    assert found.reachable.optimum == pytest.approx(-8.75, abs=1e-6)
