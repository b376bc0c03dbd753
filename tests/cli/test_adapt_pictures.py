"""What `merap adapt -o` draws: the curve of any system; a map where there is one, else the paths in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.command_line import merap
from tests.support.process_cases import SERVICE


@pytest.mark.slow
def test_without_a_map_the_paths_are_told(tmp_path: Path) -> None:
    text = re.sub(r"space:\n(  .*\n)+|  start: here\n", "", SERVICE)
    (tmp_path / "service.yaml").write_text(text, encoding="utf-8")
    run, drawn = tmp_path / "run", tmp_path / "drawn"
    trained = merap("train", tmp_path / "service.yaml", "-o", run, "--updates", 2)
    assert trained.returncode == 0, trained.stderr
    how = ("--system", "calm.fast.thrift", "--strategy", "gradient", "--steps", 1)
    adapted = merap("adapt", run, *how, "-o", drawn)
    assert adapted.returncode == 0, adapted.stderr
    told = [line for line in adapted.stdout.splitlines() if line.startswith("path ")]
    start = "running=1, booting=0, load=1, seen=never ["
    assert [line.split(": ", 1)[0] for line in told] == ["path before", "path after"]
    assert all(line.split(": ", 1)[1].startswith(start) for line in told)
    assert sorted(file.name for file in drawn.iterdir()) == ["curve.png", "curve.svg", "report.json"]
