from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.errors import InputError
from merap.mapek.scenario import read_scenario
from merap.mapek.serving import served_combination, served_scenario
from tests.support.hand_made import grid_combination

RUNNING = Path("models/running-example")
SCENARIO = """\
scenario: closing
system: {environment: b_blocked, capability: speed_high, objective: g3}
episodes: 3
changes:
  - {at: {episode: 1}, environment: {blocked: [lobby]}}
"""


@pytest.fixture(scope="module")
def case() -> DeclaredCase:
    return load_declared_case(RUNNING)


def test_a_combination_is_served_with_its_names(case: DeclaredCase) -> None:
    served = served_combination(case.system("met"), np.random.default_rng(0))
    assert served.interface.system == "met"
    assert served.interface.horizon == 40
    loc, mode = served.interface.variables
    assert loc.names == case.space.locations
    assert (mode.names, mode.low, mode.high) == (("idle", "scanning", "scanned"), 0, 2)
    assert list(served.monitor()["detections"]) == ["lidar", "light_meter"]


def test_what_is_served_can_begin_where_the_last_episode_ended() -> None:
    served = served_combination(grid_combination(goal=(0, 2)), np.random.default_rng(0), reset="none")
    for action in ("right", "right", "down"):
        served.execute({"action": action})
    served.execute({"reset": True})
    assert served.monitor()["valuation"] == {"row": 1, "col": 2, "mode": 0}


def test_a_scenario_changes_what_is_served(case: DeclaredCase, tmp_path: Path) -> None:
    """From the second episode on the only way out of S is closed."""
    file = tmp_path / "scenario.yaml"
    file.write_text(SCENARIO)
    served = served_scenario(case, read_scenario(file))
    assert served.interface.system == "closing"

    def went_east() -> bool:
        for _ in range(40):
            served.execute({"action": "east"})
        return bool(served.monitor()["valuation"]["loc"] != 0)

    assert went_east()  # every try succeeds with 0.98: 40 failures in a row do not happen
    served.execute({"reset": True})
    assert not went_east()


def test_a_scenario_of_another_case_is_refused(case: DeclaredCase, tmp_path: Path) -> None:
    file = tmp_path / "scenario.yaml"
    file.write_text(SCENARIO.replace("b_blocked", "d_blocked"))
    with pytest.raises(InputError, match=r"scenario.yaml:2: .*d_blocked"):
        served_scenario(case, read_scenario(file))
