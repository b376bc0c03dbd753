"""`merap show`: what a case consists of in words, its best policy, and a picture, with a map or without."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.support.command_line import merap, refused
from tests.support.paths import MODELS
from tests.support.prism_families import LAMPS, LAMPS_CASE
from tests.support.process_cases import SERVICE


@pytest.fixture
def lamps(tmp_path: Path) -> Path:
    (tmp_path / "lamps.prism").write_text(LAMPS, encoding="utf-8")
    (tmp_path / "lamps.yaml").write_text(LAMPS_CASE, encoding="utf-8")
    return tmp_path / "lamps.yaml"


@pytest.fixture
def service(tmp_path: Path) -> Path:
    file = tmp_path / "service.yaml"
    file.write_text(SERVICE, encoding="utf-8")
    return file


def shown(*words: object) -> list[str]:
    done = merap("show", *words)
    assert done.returncode == 0, done.stderr
    return [line.rstrip() for line in done.stdout.splitlines()]


def test_a_family_of_prism_text_in_words(lamps: Path) -> None:
    assert shown(lamps, "--optimum", "path") == [
        "lamps: 3 actions; 8 combinations of 4 x 2 x 1 configurations; online systems: met",
        "actions: left, right, switch; discount 1",
        "environment  prize: int 0..3",
        "prize_0      0",
        "prize_1      1",
        "prize_2      2",
        "prize_3      3",
        "capability  stick: probability 0..1",
        "smooth      0.1",
        "sticky      0.5",
        "objective",
        "default",
        "met: prize=2, stick=0.3",
        "horizon 30 steps, 5 states, 13 choices, 14 transitions",
        # two steps to the lamp, and 1 / 0.7 tries of its switch
        "optimum -3.42857",
        "place=0, lit=false [right: place=1] [right: place=2] (switch: lit=true)",
    ]


def test_the_best_policy_is_a_table(lamps: Path) -> None:
    assert shown(lamps, "--optimum", "policy")[-4:] == [
        "place  lit    action",
        "0..1   false  right",
        "2      false  switch",
        "3      false  left",
    ]


def test_lists_are_printed_as_lists(tmp_path: Path) -> None:
    shutil.copytree(MODELS / "running-example", tmp_path / "case")
    lines = shown(tmp_path / "case")
    assert "bc_blocked   [B, C]" in lines
    assert "environment  blocked: locations" in lines


@pytest.mark.parametrize("optimum", ["policy", "path"])
def test_pictures_are_written_where_there_is_no_map(service: Path, tmp_path: Path, optimum: str) -> None:
    system = ("--system", "rush.slow.thrift", "--optimum", optimum)
    assert shown(service, "-o", tmp_path / "drawn", *system)[-2:] == [
        f"wrote {tmp_path / 'drawn.png'}",
        f"wrote {tmp_path / 'drawn.svg'}",
    ]
    assert "exists already" in refused("show", service, "-o", tmp_path / "drawn", *system)


def test_an_attribute_needs_a_map(lamps: Path, tmp_path: Path) -> None:
    message = refused("show", lamps, "-o", tmp_path / "lamps.png", "--attribute", "light")
    assert "met has no locations, so there is no attribute 'light'" in message
