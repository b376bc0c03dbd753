"""`merap run` on a Gymnasium environment that misbehaves: one line at the start, a fault from then on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from merap.learning.config import TrainingConfig
from merap.mapek.run import GONE
from merap.runs.run_folder import RunFolder
from tests.support.command_line import merap, refused
from tests.support.faulty_lake import FAULTS
from tests.support.paths import MODELS
from tests.support.trained_runs import trained

ALL = list(range(1000))
# One of each kind: the environment's own tests have all of them.
SOME = [
    "raised: raises",
    "raised: exits",
    "observation: too high",
    "observation: text",
    "reward: array",
    "reward: not a number",
    "terminated: none",
    "truncated: 1",
    "info: short mask",
    "shape: one less",
]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """The frozen lake with one map and one kind of ice."""
    folder = tmp_path_factory.mktemp("lake")
    text = (MODELS / "frozen-lake" / "case.yaml").read_text()
    text, _, rest = text.partition("    generate:\n")
    _, _, rest = rest.partition("\n\n")
    text += f"    real: {{broken: [[1, 1], [1, 3], [2, 3], [3, 0]]}}\n\n{rest}"
    (folder / "case.yaml").write_text(text.replace("    dry: {grip: 1}\n", ""))
    config = TrainingConfig(updates=1, hidden=(4,), episodes=2)
    return trained(folder / "run", config, folder / "case.yaml")


def scenario(
    folder: Path, fault: str, call: str, calls: list[int], *, more: str = "", episodes: int = 3
) -> Path:
    arguments = json.dumps({"fault": fault, "call": call, "calls": calls})
    path = folder / "scenario.yaml"
    path.write_text(
        f"scenario: faulty\nsystem: {{gymnasium: 'tests.support.faulty_lake:FaultyLake-v0', "
        f"arguments: {arguments}, retries: 1}}\nepisodes: {episodes}\nstrategy: {{name: retrieval}}\n{more}"
    )
    return path


def report_of(run: RunFolder, path: Path, code: int = 0) -> dict[str, object]:
    """What `merap run` reports, in so many words on standard output."""
    done = merap("run", run.path, "--scenario", path, "--db", path.parent / "k.db", "--json", "-")
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("fault", SOME)
def test_a_step_that_fails_is_followed_by_the_fallback_and_the_run_goes_on(
    run: RunFolder, tmp_path: Path, fault: str
) -> None:
    assert fault in FAULTS
    path = scenario(tmp_path, fault, "step", [2], more="deadline: {fallback: left}\n")
    summary = report_of(run, path)["summary"]
    assert isinstance(summary, dict)
    assert summary["episodes"] == 3
    assert list(summary["faults"].values()) == [1]
    assert summary["fallbacks"] == 1
    events = (run.path / "events.jsonl").read_text()
    assert "FaultyLake-v0: step: " in events


@pytest.mark.parametrize("fault", ["raised: raises", "observation: below", "info: none"])
def test_a_reset_that_fails_is_made_again(run: RunFolder, tmp_path: Path, fault: str) -> None:
    summary = report_of(run, scenario(tmp_path, fault, "reset", [1]))["summary"]
    assert isinstance(summary, dict)
    assert list(summary["faults"].values()) == [1]
    assert summary["fallbacks"] == 0


def test_one_that_can_not_be_reset_any_more_ends_the_run_with_a_report(
    run: RunFolder, tmp_path: Path
) -> None:
    path = scenario(tmp_path, "raised: aborts", "reset", ALL[1:], episodes=20)
    report = report_of(run, path, code=3)
    assert str(report["ended_by"]).startswith(f"gone: none of the last {GONE} episodes could begin")
    assert isinstance(report["episodes"], list)
    assert len(report["episodes"]) == 1 + GONE


def test_one_whose_every_step_fails_ends_each_episode_and_not_the_run(run: RunFolder, tmp_path: Path) -> None:
    summary = report_of(run, scenario(tmp_path, "reward: list", "step", ALL))["summary"]
    assert isinstance(summary, dict)
    assert summary["episodes"] == 3
    assert summary["completed"] == 0


@pytest.mark.parametrize("call", ["close", "step", "reset"])
def test_a_warning_or_a_failing_close_changes_nothing(run: RunFolder, tmp_path: Path, call: str) -> None:
    fault = "raised: raises" if call == "close" else "warns: "
    summary = report_of(run, scenario(tmp_path, fault, call, ALL))["summary"]
    assert isinstance(summary, dict)
    assert (summary["episodes"], summary["faults"]) == (3, {})


@pytest.mark.parametrize(
    ("system", "message"),
    [
        ("{gymnasium: FrozenLake-v1, arguments: {nonsense: 1}}", "unexpected keyword argument 'nonsense'"),
        ("{gymnasium: FrozenLake-v1, arguments: {map_name: 9x9}}", "KeyError: '9x9'"),
        ("{gymnasium: Nothing-v0}", "Environment `Nothing` doesn't exist"),
        ("{gymnasium: 'no_such_module:Lake-v0'}", "No module named 'no_such_module'"),
        ("{gymnasium: CartPole-v1}", "is no space of whole numbers"),
        ("{gymnasium: Taxi-v4}", "it has the actions south, north"),
        (
            "{gymnasium: 'tests.support.faulty_lake:FaultyLake-v0', "
            "arguments: {fault: 'raised: exits', call: make, calls: [0]}}",
            "SystemExit: enough",
        ),
    ],
)
def test_one_that_can_not_be_had_is_an_input_error_that_names_file_and_key(
    run: RunFolder, tmp_path: Path, system: str, message: str
) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(f"scenario: none\nepisodes: 1\nsystem: {system}\n")
    line = refused("run", run.path, "--scenario", path, "--db", tmp_path / "k.db", "--log", tmp_path / "log")
    assert line.startswith(f"error: {path}:3: system: ")
    assert message in line


def test_without_gymnasium_it_says_how_to_get_it(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [
        name for name in sys.modules if name.startswith(("merap.mdp.gymnasium", "merap.systems.gymnasium"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    path = scenario(tmp_path, "", "step", [])
    line = refused("run", run.path, "--scenario", path, "--db", tmp_path / "k.db", "--log", tmp_path / "log")
    assert line.startswith(f"error: {path}:2: system: this needs Gymnasium")
