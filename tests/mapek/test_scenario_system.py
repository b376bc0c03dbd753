from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import ResetMode
from merap.errors import InputError
from merap.families.loading import load_case
from merap.mapek.scenario import read_scenario
from merap.mapek.scenario_schema import NoiseSpec
from merap.mapek.scenario_system import ScenarioSystem
from merap.systems.description import shown_variables
from tests.support.case_examples import write_case
from tests.support.paths import MODELS
from tests.support.process_cases import SERVICE

GRID = MODELS / "paper-grid" / "rq1-1.yaml"
STOP, UP, DOWN, LEFT, RIGHT = range(5)
DRAWS = 4000
# The goal's four cells lie around (3, 3); the paper's step costs 0.5 and stopping there earns 10.
CHANGES = """\
scenario: moving
system: {{objective: {{goal: [0, 2]}}}}
episodes: 9
changes:
  - {{at: {first}, objective: {{goal: [2, 0]}}}}
  - {{at: {second}, objective: {{goal: [0, 1]}}}}
"""


@pytest.fixture(scope="module")
def case() -> CaseStudy:
    return load_case(GRID)


def system(
    case: CaseStudy,
    folder: Path,
    first: str = "{episode: 1}",
    second: str = "{episode: 2}",
    noise: NoiseSpec | None = None,
    reset: ResetMode = "episodes",
    seed: int = 0,
) -> ScenarioSystem:
    path = folder / "scenario.yaml"
    path.write_text(CHANGES.format(first=first, second=second))
    spec = noise or NoiseSpec()
    return ScenarioSystem(read_scenario(path).stages(case), spec, reset, np.random.default_rng(seed))


def played(simulated: ScenarioSystem, actions: list[int]) -> list[float]:
    """Rewards of an episode."""
    simulated.reset()
    return [simulated.step(action).reward for action in actions]


def test_each_stage_is_in_force_from_its_episode_on(case: CaseStudy, tmp_path: Path) -> None:
    simulated = system(case, tmp_path)
    stages, returns = [], []
    for actions in ([RIGHT, RIGHT, STOP], [DOWN, DOWN, STOP], [RIGHT, STOP]):
        returns.append(sum(played(simulated, actions)))
        stages.append(simulated.stage)
    assert (stages, returns) == ([0, 1, 2], [9.0, 9.0, 9.5])


def test_a_change_amid_an_episode_begins_after_its_step(case: CaseStudy, tmp_path: Path) -> None:
    """After one step the goal is where the robot stands two steps later; before, it would not be."""
    simulated = system(case, tmp_path, "{episode: 0, step: 1}", "{episode: 3}")
    assert played(simulated, [DOWN, DOWN, STOP]) == [-0.5, -0.5, 10.0]
    assert simulated.stage == 1
    assert simulated.tally.completed


def test_a_change_that_would_wall_the_system_in_waits(tmp_path: Path) -> None:
    """RQ1-2 has its obstacles drawn: the cell where the robot stands gets one after its first step."""
    grid = load_case(GRID.with_name("rq1-2.yaml"))
    path = tmp_path / "scenario.yaml"
    path.write_text(
        "scenario: wall\nsystem: met\nepisodes: 1\nchanges:\n"
        "  - {at: {episode: 0, step: 1}, environment: {blocked: [[0, 1], [3, 2], [4, 2], [4, 3]]}}\n"
    )
    stages = read_scenario(path).stages(grid)
    simulated = ScenarioSystem(stages, NoiseSpec(), "episodes", np.random.default_rng(0))
    simulated.reset()
    assert simulated.step(RIGHT).valuation.tolist()[:2] == [0, 1]
    assert simulated.stage == 0
    assert simulated.step(STOP).valuation.tolist()[:2] == [0, 1]
    assert simulated.stage == 0
    assert simulated.step(LEFT).valuation.tolist()[:2] == [0, 0]
    assert simulated.stage == 1
    assert simulated.step(RIGHT).valuation.tolist()[:2] == [0, 0]


def test_the_tally_is_without_noise(case: CaseStudy, tmp_path: Path) -> None:
    simulated = system(case, tmp_path, noise=NoiseSpec(reward=1.0))
    received = played(simulated, [RIGHT, RIGHT, STOP])
    tally = simulated.tally
    assert (tally.steps, tally.earned, tally.unsafe, tally.completed) == (3, 9.0, 0, True)
    discount = 0.95
    assert tally.discounted == pytest.approx(-0.5 - 0.5 * discount + 10 * discount**2)
    assert sum(received) != 9.0


def test_noise_has_its_deviation(case: CaseStudy, tmp_path: Path) -> None:
    """4 standard errors of mean and variance of a normal sample: fails by luck once in 8,000."""
    deviation = 0.7
    simulated = system(case, tmp_path, noise=NoiseSpec(reward=deviation))
    drawn = np.array([played(simulated, [STOP])[0] + 0.5 for _ in range(DRAWS)])
    assert abs(drawn.mean()) <= 4 * deviation / math.sqrt(DRAWS)
    assert abs(drawn.var() - deviation**2) <= 4 * deviation**2 * math.sqrt(2 / DRAWS)


def test_slip_is_part_of_the_truth(case: CaseStudy, tmp_path: Path) -> None:
    """A move is repeated 1 / (1 - w) times on average; a stop in the goal ends and earns even if it slips.

    The horizon of 18 steps matters with probability 1e-14.
    """
    slip = 0.1
    simulated = system(case, tmp_path, noise=NoiseSpec(slip=slip))
    optimum = 10 - 2 * 0.5 / (1 - slip)
    assert simulated.truth.reachable.optimum == pytest.approx(optimum, abs=1e-6)


def test_where_the_system_is_not_reset_it_stays(case: CaseStudy, tmp_path: Path) -> None:
    simulated = system(case, tmp_path, reset="none")
    played(simulated, [RIGHT, RIGHT, STOP])
    assert simulated.reset().valuation.tolist()[:2] == [0, 2]
    assert simulated.stage == 1


def test_a_snapshot_goes_on_as_if_nothing_had_happened(case: CaseStudy, tmp_path: Path) -> None:
    noise = NoiseSpec(reward=0.5, slip=0.2)
    one = system(case, tmp_path, noise=noise, seed=1)
    other = system(case, tmp_path, noise=noise, seed=2)
    played(one, [RIGHT, RIGHT, DOWN])
    played(one, [DOWN])
    other.restore(json.loads(json.dumps(one.snapshot())))
    assert (other.stage, other.tally) == (1, one.tally)
    assert played(one, [DOWN] * 9) == played(other, [DOWN] * 9)
    assert (one.stage, other.stage) == (2, 2)


def test_what_is_no_snapshot_is_refused(case: CaseStudy, tmp_path: Path) -> None:
    for snapshot in ({}, {"stage": 7, "episode": 0, "tally": {}}, {"stage": 0, "episode": 0, "tally": 1}):
        with pytest.raises(InputError, match="recorded state of the system"):
            system(case, tmp_path).restore(snapshot)


def test_a_loop_numbers_its_episodes_though_a_reset_fails_or_is_repeated(
    case: CaseStudy, tmp_path: Path
) -> None:
    """The reset of episode 1 never gets here, that of episode 2 twice: the second change is in force in 2."""
    simulated = system(case, tmp_path)
    simulated.begin(0)
    simulated.reset()
    simulated.step(RIGHT)
    simulated.begin(1)
    assert simulated.tally.steps == 0
    simulated.begin(2)
    simulated.reset()
    assert (simulated.reset().last, simulated.episode, simulated.stage) == (False, 2, 2)


def test_left_out_an_episode_begins_as_the_system_says(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text("scenario: lasting\nsystem: {objective: {goal: [0, 2]}, reset: none}\nepisodes: 2\n")
    read = read_scenario(path)
    stages = read.stages(load_case(GRID))
    lasting = ScenarioSystem(stages, read.spec.noise, read.spec.reset, np.random.default_rng(0))
    played(lasting, [RIGHT, RIGHT, STOP])
    assert lasting.reset().valuation[:2].tolist() == [0, 2]


def test_where_episodes_last_what_is_possible_is_so_from_where_they_begin(
    case: CaseStudy, tmp_path: Path
) -> None:
    """The goal (0, 2) is two steps from the start; the second episode begins there."""
    lasting = system(case, tmp_path, "{episode: 7}", "{episode: 8}", reset="none")
    found = []
    for actions in ([RIGHT, RIGHT, STOP], [STOP]):
        played(lasting, actions)
        found.append(lasting.truth.reachable.optimum)
    assert found == [9.0, 10.0]
    back = system(case, tmp_path, "{episode: 7}", "{episode: 8}", reset="return_to_start")
    for actions in ([RIGHT, RIGHT, STOP], [RIGHT, RIGHT, STOP]):
        played(back, actions)
        assert back.truth.reachable.optimum == 9.0


BUSIER = """\
scenario: busier
system: calm.fast.thrift
episodes: 3
changes:
  - {at: {episode: 0, step: 3}, environment: {up: 0.6, down: 0}}
  - {at: {episode: 1}, objective: quality}
"""


def test_processes_go_on_through_changes(tmp_path: Path) -> None:
    """A service whose load only grows from the fourth step on, and whose user wants it faster then."""
    (tmp_path / "busier.yaml").write_text(BUSIER)
    service = load_case(write_case(tmp_path, SERVICE))
    stages = read_scenario(tmp_path / "busier.yaml").stages(service)
    assert [stage.changed for stage in stages] == [(), ("environment",), ("objective",)]
    assert stages[1].system.environment.parameters == {"up": 0.6, "down": 0}
    simulated = ScenarioSystem(stages, NoiseSpec(), "none", np.random.default_rng(0))
    keep = simulated.actions.index("keep")
    loads, rewards = [], []
    for _ in range(2):
        seen = simulated.reset()
        while not seen.last:
            loads.append(int(seen.valuation[_column(service, "load")]))
            seen = simulated.step(keep)
            rewards.append(seen.reward)
    assert loads[3:] == sorted(loads[3:])
    assert loads[-1] == 4
    assert rewards[-1] == -4 * 3 - 1
    assert simulated.truth.begun is not None
    assert simulated.truth.begun["load"] == 4


def _column(service: CaseStudy, name: str) -> int:
    return [one.name for one in shown_variables(service.combination_at(0).program)].index(name)
