"""`export-policy` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.storm import build_file
from merap.cli.policies import PolicyFormat, export_policy
from merap.errors import InputError
from merap.runs.run_folder import RunFolder
from tests.support.command_line import merap, refused
from tests.support.trained_runs import trained


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "finished")


def test_a_table_for_the_whole_base(finished: RunFolder, tmp_path: Path) -> None:
    out = tmp_path / "policy.csv"
    done = merap("export-policy", finished.path, "-o", out)
    assert done.returncode == 0, done.stderr
    lines = out.read_text().splitlines()
    assert lines[0] == "row,col,mode,stop,up,down,left,right"
    assert len(lines) == 82  # 81 cells, one of the three closed ones in each model
    assert done.stdout == f"paper_rq1_3: the meta policy; wrote {out}\n"


def test_an_adapted_policy_as_a_chain(finished: RunFolder, tmp_path: Path) -> None:
    out = tmp_path / "policy.prism"
    options = ["--format", "prism", "--system", "met", "--adapt-steps", "1", "--episodes-per-step", "3"]
    done = merap("export-policy", finished.path, *options, "-o", out)
    assert done.returncode == 0, done.stderr
    title = "paper_rq1_3 on met: 1 gradient step of 3 episodes, seed 0"
    assert done.stdout == f"{title}; wrote {out}\n"
    assert out.read_text().startswith(f"// {title}\n")
    value = build_file(out).check('R{"objective"}=? [C<=18]').value
    assert value is not None
    assert -9 <= value <= 6  # 18 steps without the goal, and the optimum


def test_arrays(finished: RunFolder, tmp_path: Path) -> None:
    out = tmp_path / "policy.npz"
    export_policy(finished.path, out, PolicyFormat.npz, "met")
    assert np.load(out)["probabilities"].shape[1] == 5


@pytest.mark.parametrize(
    ("kind", "system", "steps", "complaint"),
    [
        ("prism", None, 0, "--system: --format prism needs a system; those of the case: met"),
        ("csv", None, 3, "--system: --adapt-steps needs a system; those of the case: met"),
        ("csv", "mett", 0, "has no system 'mett'; did you mean 'met'"),
    ],
)
def test_what_makes_no_sense_is_refused(
    finished: RunFolder, tmp_path: Path, kind: str, system: str | None, steps: int, complaint: str
) -> None:
    out = tmp_path / "policy"
    with pytest.raises(InputError, match=complaint):
        export_policy(finished.path, out, PolicyFormat(kind), system, steps)
    assert not out.exists()


def test_nothing_is_written_over(finished: RunFolder, tmp_path: Path) -> None:
    out = tmp_path / "policy.csv"
    out.write_text("mine")
    assert "exists already" in refused("export-policy", finished.path, "-o", out)
    assert out.read_text() == "mine"
