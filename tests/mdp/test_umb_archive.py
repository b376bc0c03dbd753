"""Damaged archives: refused with a sentence, never read past their end."""

from __future__ import annotations

import gzip
import lzma
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from merap.errors import InputError, MerapError, ModelError
from merap.mdp.umb import read_umb
from tests.support.umb_example import Entries, Index, doubles, saved, standard_example, tar_bytes, words


def changed(path: tuple[str | int, ...], value: object) -> Callable[[Index, Entries], None]:
    def change(index: Index, _: Entries) -> None:
        place: Any = index
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return change


def without(name: str) -> Callable[[Index, Entries], None]:
    return lambda _, entries: entries.__delitem__(name)


def entry(name: str, data: bytes) -> Callable[[Index, Entries], None]:
    return lambda _, entries: entries.__setitem__(name, data)


SYSTEM = "transition-system"
VARIABLES = ("valuations", "states", "classes", 0, "variables")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("branch-to-target.bin"), r"branch-to-target\.bin is missing"),
        (without("branch-to-probability.bin"), r"branch-to-probability\.bin is missing"),
        (without("state-to-choices.bin"), r"state-to-choices\.bin is missing"),
        (without("choice-to-branches.bin"), r"choice-to-branches\.bin is missing"),
        (without("state-is-initial.bin"), r"state-is-initial\.bin is missing"),
        (without("actions/choices/strings.bin"), r"strings\.bin is missing"),
        (without("annotations/aps/g/states/values.bin"), r"aps/g/states/values\.bin is missing"),
        (without("annotations/rewards/r/choices/values.bin"), r"r/choices/values\.bin is missing"),
        (without("valuations/states/valuations.bin"), r"valuations\.bin is missing"),
        (entry("state-to-choices.bin", words(0, 5)), r"state-to-choices\.bin has 16 bytes, not 40"),
        (entry("branch-to-target.bin", words(1, 2, 2, 4, 0, 1, 2, 3)), r"holds 0..4, allowed is 0..3"),
        (entry("branch-to-target.bin", words(1, 2, 2, 2**64 - 9, 0, 1, 2, 3)), r"holds -9..3, allowed"),
        (entry("state-to-choices.bin", words(0, 3, 2, 4, 5)), r"state-to-choices\.bin must rise"),
        (entry("choice-to-branches.bin", words(0, 2, 4, 6, 7, 9)), r"must rise from 0 to 8"),
        (
            entry("branch-to-probability.bin", doubles(*[0.5] * 8)),
            r"\(x=2, b=0\), action a: prob",
        ),
        (entry("state-is-initial.bin", words(0)), r"no state is initial"),
        (entry("actions/choices/strings.bin", b"\xff\xfe"), r"an action name isn't UTF-8"),
        (entry("actions/choices/strings.bin", b"aa"), r"action name 'a' is there twice"),
        (entry("actions/choices/string-mapping.bin", words(0, 9, 2)), r"must rise from 0 to 2"),
        (entry("actions/choices/values.bin", bytes([9, 0, 0, 0] * 5)), r"choice_action holds 9..9"),
        (entry("valuations/states/valuations.bin", bytes([0, 1, 1, 2])), r"are both \(x=1, b=0\)"),
        (entry("annotations/rewards/r/choices/values.bin", doubles(*[np.nan] * 5)), r"has reward nan"),
        (
            changed((SYSTEM, "#states"), 10**30),
            r"transition-system\.#states: .*less than or equal",
        ),
        (changed((SYSTEM, "#states"), 2**50), r"state-to-choices\.bin has 40 bytes, not"),
        (changed((SYSTEM, "#branches"), 2**50), r"branch-to-target\.bin has 64 bytes, not"),
        (changed((SYSTEM, "#choice-actions"), 2**50), r"string-mapping\.bin has 24 bytes, not"),
        (changed((SYSTEM, "#states"), -1), r"#states: .*greater than or equal to 1"),
        (changed((SYSTEM, "#states"), "many"), r"#states: .*valid integer"),
        (changed((SYSTEM, "#players"), 2), r"neither MDP nor Markov chain"),
        (changed((SYSTEM, "time"), "stochastic"), r"stochastic time"),
        (changed((SYSTEM, "branch-probability-type"), {"type": "rational"}), r"must be of type double"),
        (changed((SYSTEM, "branch-probability-type"), None), r"must be of type double"),
        (changed(("format-version",), 2), r"index\.json\.format-version"),
        (changed((SYSTEM,), []), r"index\.json\.transition-system"),
        (changed(("annotations", "aps", "g", "type"), {"type": "int"}), r"label 'g' must be one Boolean"),
        (changed(("annotations", "rewards", "r", "type"), {"type": "int"}), r"'r' must give doubles"),
        (changed(("annotations", "rewards", "r", "applies-to"), ["players"]), r"'r' must give doubles"),
        (changed(("valuations",), {}), r"no state valuations"),
        (changed(("valuations", "states", "classes"), []), r"0 classes of state valuations"),
        (changed((*VARIABLES, 0, "type"), {"type": "double"}), r"'x' is double of 64 bits"),
        (changed((*VARIABLES, 0, "type"), {"type": "int", "size": 65}), r"'x' is int of 65 bits"),
        (changed((*VARIABLES, 0, "is-optional"), True), r"'x' is optional uint"),
        (changed((*VARIABLES, 0, "offset"), 2**63 - 2), r"'x' has values past 64 bits"),
        (changed((*VARIABLES, 1, "name"), "x"), r"two state variables have one name"),
        (changed((*VARIABLES, 2, "padding"), 4), r"has 7 bits, not whole bytes"),
        (changed((*VARIABLES, 2, "padding"), 13), r"valuations\.bin has 4 bytes, not 8"),
    ],
)
def test_a_damaged_archive_is_refused(
    tmp_path: Path, change: Callable[[Index, Entries], None], message: str
) -> None:
    index, entries = standard_example()
    change(index, entries)
    path = saved(tmp_path / "mdp.umb", tar_bytes(index, entries))
    with pytest.raises((InputError, ModelError), match=message) as caught:
        read_umb(path, reward="r")
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a UMB archive"),
        (b"not a tar file" * 100, "not a UMB archive"),
        (bytes(2048), "index.json is missing"),
        (tar_bytes(*standard_example())[:3000], r"branch-to-target\.bin is missing"),
        (tar_bytes(*standard_example())[:3100], "not a UMB archive"),
        # a fixed time, since parallel workers must collect the same tests
        (gzip.compress(tar_bytes(*standard_example()), mtime=0)[:-40], "not a UMB archive"),
        (gzip.compress(b"hello", mtime=0), "not a UMB archive"),
        (lzma.compress(tar_bytes(*standard_example()))[:-40], "not a UMB archive"),
        (tar_bytes(b"{", {}), "index.json: Invalid JSON"),
        (tar_bytes(b"[" * 100_000, {}), "index.json: Invalid JSON"),
        (tar_bytes(b"\xff\xff", {}), "index.json: Invalid JSON"),
        (tar_bytes(b"{}", {}), r"index\.json\.format-version: Field required"),
    ],
)
def test_what_is_no_archive_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_umb(saved(tmp_path / "mdp.umb", data))


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.umb: can't be read \(No such file or directory\)"):
        read_umb(tmp_path / "nowhere.umb")
    with pytest.raises(InputError, match=r"can't be read \(Is a directory\)"):
        read_umb(tmp_path)


@pytest.mark.parametrize("seed", range(8))
def test_random_damage_is_an_error_or_still_a_model(tmp_path: Path, seed: int) -> None:
    # Any other exception, or a crash, fails: the reader indexes memory by what it reads.
    generator = np.random.default_rng(seed)
    whole = np.frombuffer(tar_bytes(*standard_example()), dtype=np.uint8)
    used = np.flatnonzero(whole)
    refused = 0
    for attempt in range(60):
        damaged = whole.copy()
        places = generator.choice(used, size=int(generator.integers(1, 6)))
        damaged[places] = generator.integers(0, 256, size=len(places))
        if attempt % 10 == 0:
            damaged = damaged[: generator.integers(0, len(damaged))]
        try:
            mdp = read_umb(saved(tmp_path / f"{attempt}.umb", damaged.tobytes()), reward="r")
        except MerapError:
            refused += 1
        else:
            assert mdp.num_states >= 1
    assert refused > 20
