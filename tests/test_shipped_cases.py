"""Every case that is shipped works with every command of the README."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path

import pytest

from merap.cli.app import app
from tests.support.command_line import command, merap
from tests.support.paths import MODELS, ROOT
from tests.support.shipped_cases import CASE_FILES

CASES = [path.parent if path.name == "case.yaml" else path for path in CASE_FILES]
# Where only the machinery matters and not what is learned.
SMALL = ("--updates", "2", "--set", "hidden=[4]", "--set", "episodes=5", "--set", "max_tasks=6")
SCENARIO = "scenario: short\nsystem: met\nepisodes: {episodes}\n"
ON_A_MAP_ALONE = {"running-example", "hazard-grid", "frozen-lake", "paper-grid"}


def fewest_episodes(case: Path) -> int:
    """How few episodes the default strategy takes: belief some, gradient those of a step."""
    return 3 if {case.name, case.parent.name} & ON_A_MAP_ALONE else 35


def modelling_commands(case: Path, folder: Path) -> list[list[object]]:
    """Every command of the README that makes, shows or checks models."""
    few = ("--sample", "2")
    return [
        ["validate", case],
        ["show", case, "-o", folder / "map.svg"],
        ["show", case, "-o", folder / "path.png", "--optimum", "path"],
        ["render", case, "-o", folder / "prism", *few],
        ["verify", case, "--json", folder / "verdicts.json", *few],
        ["export", case, "-o", folder / "umb", *few],
        ["schema"],
        ["doctor"],
    ]


def learning_commands(case: Path, folder: Path) -> list[list[object]]:
    """The other commands of the README, in an order that can be run; `serve` has a test of its own."""
    run, scenario = folder / "run", folder / "scenario.yaml"
    return [
        ["difference", case],
        ["difference", case, "--system", "met"],
        ["train", case, "-o", run, *SMALL],
        ["train", "-o", run, "--resume"],
        ["adapt", run, "--system", "met", "--max-episodes", fewest_episodes(case), "-o", folder / "adapted"],
        ["adapt", run, "--strategy", "gradient", "--steps", "1", "--seeds", "0:2"],
        ["export-policy", run, "-o", folder / "policy.csv"],
        ["export-policy", run, "-o", folder / "policy.npz", "--format", "npz"],
        ["export-policy", run, "-o", folder / "policy.prism", "--format", "prism", "--system", "met"],
        ["run", run, "--scenario", scenario, "-o", folder / "loop"],
        ["knowledge", "list", "--db", run],
        ["knowledge", "show", 1, "--db", run],
        ["knowledge", "export", 1, "--db", run, "-o", folder / "knowledge"],
        ["knowledge", "replay", 1, "--db", run, "--check", run],
    ]


def shown_in_readme() -> set[str]:
    """The verbs of the README's table."""
    table = re.findall(r"^\| `merap ([^|]*(?:\\\|[^|]*)*)\|", (ROOT / "README.md").read_text(), re.MULTILINE)
    return {verb for row in table for verb in re.findall(r"(?:^|merap )([a-z][a-z-]+)", row)}


def test_all_shipped_cases_are_found() -> None:
    names = {str(case.relative_to(MODELS)) for case in CASES}
    grids = {f"paper-grid/rq1-{number}.yaml" for number in range(1, 9)}
    families = {f"families/{name}.yaml" for name in ("radio", "pump")}
    others = {"running-example", "hazard-grid", "frozen-lake", "hospital", "web-service", "drone"}
    assert names == others | families | grids


def test_every_verb_is_in_the_readme_and_here(tmp_path: Path) -> None:
    every = [*modelling_commands(MODELS, tmp_path), *learning_commands(MODELS, tmp_path)]
    here = {str(words[0]) for words in every} | {"serve", "check"}  # a model, not a case
    verbs = {
        one.name or one.callback.__name__.replace("_", "-") for one in app.registered_commands if one.callback
    } | {group.name for group in app.registered_groups}
    assert here == shown_in_readme() == verbs


def succeed(commands: list[list[object]]) -> None:
    """Every command succeeds and says nothing of an error."""
    for words in commands:
        done = merap(*words)
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
        assert "error" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_every_command_for_models_works(case: Path, tmp_path: Path) -> None:
    succeed(modelling_commands(case, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_every_command_for_learning_works(case: Path, tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(SCENARIO.format(episodes=fewest_episodes(case)))
    succeed(learning_commands(case, tmp_path))


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_a_case_can_be_served(case: Path) -> None:
    process = subprocess.Popen(
        command("serve", case, "--port", "0", "--quiet"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert line.startswith("met of "), err
    assert (process.returncode, out) == (0, "ended\n")
