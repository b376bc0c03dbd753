"""`merap check`: tables, notes, reports, pictures and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command_line import merap, refused
from tests.support.dice import CLIMB

pytestmark = pytest.mark.process


@pytest.fixture
def climb(tmp_path: Path) -> Path:
    path = tmp_path / "climb.prism"
    path.write_text(CLIMB, encoding="utf-8")
    return path


def test_one_choice_of_constants_is_a_row_for_each_property(climb: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    text = 'Pmax=? [F<=2 high]; "kept": P>=0.25 [G<=2 x<3]'
    done = merap("check", climb, text, "--const", "N=3,p=0.5", "--json", report)
    assert done.returncode == 0
    assert done.stderr == "warning: 1 state has no action, as (x=3): a loop is added, as PRISM does\n"
    head, first, second = (line.split() for line in done.stdout.splitlines())
    assert head == ["property", "value", "precision", "method", "seconds"]
    assert first[:5] == ["Pmax=?", "[F<=2", "high]", "0.25", "0"]
    assert second[:5] == ["kept", "true", "(1)", "0", "doubles"]
    content = json.loads(report.read_text())
    assert [one["value"] for one in content["results"]] == [0.25, 1]
    assert content["results"][0]["constants"] == {"N": "3", "p": "0.5"}
    assert content["model"] == str(climb)
    assert len(content["notes"]) == 1


def test_ranges_are_a_table_and_a_picture(climb: Path, tmp_path: Path) -> None:
    picture = tmp_path / "values.svg"
    words = ("check", climb, "const int k; Pmax=? [F<=k high]", "--const", "N=3,p=0.5", "--const", "k=1:3")
    done = merap(*words, "--plot", picture)
    assert done.returncode == 0
    assert [line.split() for line in done.stdout.splitlines()] == [
        ["k", "Pmax=?", "[F<=k", "high]"],
        ["1", "0"],
        ["2", "0.25"],
        ["3", "0.5"],
    ]
    assert picture.read_text().startswith("<?xml")
    assert "exists already" in refused(*words, "--plot", picture)


def test_exit_codes(climb: Path) -> None:
    constants = ("--const", "N=3,p=0.5")
    assert merap("check", climb, "P>=1 [F high]", *constants).returncode == 1
    unanswered = merap("check", climb, "multi(P>=1 [F high])", *constants)
    assert unanswered.returncode == 3
    assert unanswered.stdout.splitlines()[-1].startswith("unsupported: ")
    assert refused("check", climb, "Pmax=? [F high", *constants).endswith(
        "syntax error at column 15, at the end"
    )
    assert "a plot needs a constant with several values" in refused(
        "check", climb, "Pmax=? [F high]", *constants, "--plot", "x.svg"
    )
