"""The short programs of `scripts/` take every case that is shipped."""

from __future__ import annotations

import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import merap
from tests.support.paths import ROOT
from tests.support.shipped_cases import CASE_FILES

SMALL: dict[str, Any] = {"updates": 2, "hidden": [4], "episodes": 5, "max_tasks": 6}


def run(monkeypatch: pytest.MonkeyPatch, name: str, *arguments: Path) -> None:
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(ROOT / "scripts" / name), run_name="__main__")


@pytest.mark.slow
@pytest.mark.parametrize("path", CASE_FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_scripts_take_every_case(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    count = min(merap.load_case(path).size, 20)
    run(monkeypatch, "render_models.py", path, tmp_path / "models")
    assert (
        int(capsys.readouterr().out.split()[0]) == len(list((tmp_path / "models").glob("*.prism"))) >= count
    )

    run(monkeypatch, "verify_models.py", path)
    assert len({line.split()[0] for line in capsys.readouterr().out.splitlines()}) >= count

    # what is learned does not matter here
    train, adapt = merap.train, merap.adapt
    monkeypatch.setattr(merap, "train", partial(train, **SMALL))
    monkeypatch.setattr(merap, "adapt", lambda *words, **named: adapt(*words, **named | {"steps": 1}))
    run(monkeypatch, "train_meta_policy.py", path, tmp_path / "run")
    optimum, *seeds = capsys.readouterr().out.splitlines()
    assert optimum.startswith("optimum ")
    assert len(seeds) == 3
