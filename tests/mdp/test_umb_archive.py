"""Damaged archives: refused with a sentence, never read past their end."""

from __future__ import annotations

import gzip
import lzma
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from merap.errors import InputError, ModelError
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
G: dict[str, object] = {"applies-to": ["states"], "type": {"type": "bool"}}
R: dict[str, object] = {"applies-to": ["choices"], "type": {"type": "double"}}
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
        (entry("state-is-initial.bin", words(0b11)), r"#initial-states is 1, but .* marks 2"),
        (changed((SYSTEM, "#initial-states"), 3), r"#initial-states is 3, but .* marks 1"),
        (changed((SYSTEM, "#initial-states"), 0), r"#initial-states is 0, but .* marks 1"),
        (entry("state-is-initial.bin", words(0b10001)), r"bits beyond the 4 that it is for"),
        (entry("annotations/aps/g/states/values.bin", words(1 << 63)), r"bits beyond the 4"),
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
        (changed((SYSTEM, "#states"), "4"), r"#states: .*valid integer"),
        (changed((SYSTEM, "#states"), True), r"#states: .*valid integer"),
        (changed((SYSTEM, "#states"), 3), r"branch-to-target\.bin holds 0..3, allowed is 0..2"),
        (changed((SYSTEM, "#states"), 5), r"state-to-choices\.bin has 40 bytes, not 48"),
        (changed((SYSTEM, "#choices"), 4), r"choice-to-branches\.bin has 48 bytes, not 40"),
        (changed((SYSTEM, "#choices"), 6), r"choice-to-branches\.bin has 48 bytes, not 56"),
        (changed((SYSTEM, "#branches"), 7), r"branch-to-target\.bin has 64 bytes, not 56"),
        (changed((SYSTEM, "#choice-actions"), 3), r"string-mapping\.bin has 24 bytes, not 32"),
        (changed((SYSTEM, "#choice-actions"), 0), r"values\.bin is there, but #choice-actions is 0"),
        (changed((SYSTEM, "#players"), 0), r"a state has 2 choices, but there is no player"),
        (changed(("annotations", "a\nb"), 0), r"annotations\.'a\\nb': Input should"),
        (changed((SYSTEM, "player-names"), ["one", "two"]), r"2 player names, but 1 players"),
        (entry("state-to-player.bin", bytes([1, 0, 0, 0] * 4)), r"state-to-player\.bin holds 1..1"),
        (entry("state-to-player.bin", bytes(4)), r"state-to-player\.bin has 4 bytes, not 16"),
        (entry("state-to-exit-rate.bin", doubles(1, 1, 1, 1)), r"no place in a model of discrete time"),
        (entry("actions/branches/values.bin", bytes(32)), r"but #branch-actions is 0"),
        (without("actions/choices/string-mapping.bin"), r"strings\.bin is there without"),
        (entry("valuations/states/valuation-to-class.bin", bytes([1, 0, 0, 0] * 4)), r"holds 1..1"),
        (changed((*VARIABLES, 0, "upper"), 1), r"'x' has values 0..2, declared are 0..1"),
        (changed((*VARIABLES, 0, "lower"), 1), r"'x' has values 0..2, declared are 1..2"),
        (entry("branch-to-probability.bin", doubles(-0.5, 1.5, 0.2, 0.8, 0.9, 0.1, 1, 1)), r"of -0.5"),
        (changed(("annotations", "aps", "h"), G | {"alias": "g"}), r"label 'g' must be .* once"),
        (changed(("annotations", "rewards", "s"), R | {"alias": "r"}), r"two reward structures 'r'"),
        (changed(("annotations", "rewards", "r", "applies-to"), []), r"applies-to: .* at least 1 item"),
        (changed(("annotations", "rewards", "r", "type"), {"type": "rational"}), r"has 40 bytes, not 80"),
        (changed(("annotations", "rewards", "r", "type"), {"type": "double-interval"}), r"must give doubles"),
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


def a_link(data: bytes) -> bytes:
    """Turn the entry with the labels into a symbolic link, with the header's check sum mended."""
    changed = bytearray(data)
    start = data.index(b"annotations/aps/g/states/values.bin")
    changed[start + 156 : start + 157] = tarfile.SYMTYPE
    changed[start + 148 : start + 156] = b" " * 8
    changed[start + 148 : start + 156] = f"{sum(changed[start : start + 512]):06o}".encode() + b"\0 "
    return bytes(changed)


def test_an_entry_must_be_a_plain_file_that_is_there_once(tmp_path: Path) -> None:
    once = tar_bytes(*standard_example())
    for data in (a_link(once), once[: once.rindex(b"valuations/states")] + once):
        with pytest.raises(InputError, match="is there twice or is no plain file"):
            read_umb(saved(tmp_path / "mdp.umb", data), reward="r")


@pytest.mark.parametrize("where", ["cut", "header"])
def test_an_entry_that_may_be_lost_is_not_taken_for_absent(tmp_path: Path, where: str) -> None:
    # absent labels hold nowhere, so a file that ends before them must not be read so
    index, entries = standard_example()
    last = "annotations/aps/g/states/values.bin"
    entries[last] = entries.pop(last)
    data = bytearray(tar_bytes(index, entries))
    start = data.index(b"annotations/aps/g")
    if where == "cut":
        del data[start:]
    else:
        data[start] ^= 1  # its check sum is wrong now, and all that follows is passed over
    with pytest.raises(InputError, match=r"the file is cut off or damaged, .*\.bin may be lost"):
        read_umb(saved(tmp_path / "mdp.umb", bytes(data)), reward="r")


def test_a_name_with_a_line_break_does_not_break_the_message(tmp_path: Path) -> None:
    index, entries = standard_example()
    entries["actions/choices/strings.bin"] = b"a\n"
    entries["branch-to-probability.bin"] = doubles(0.5, 0.5, 0.3, 0.8, 0.9, 0.1, 1, 1)
    with pytest.raises(ModelError, match=r"\(x=0, b=0\), action '\\n': probabilities sum to 1.1"):
        read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward="r")


def test_the_sizes_that_an_index_names_are_not_allocated(tmp_path: Path) -> None:
    # by the defaults of the format, such an archive has no entry for states and choices
    index, entries = standard_example()
    index["transition-system"] |= {"#states": 2**50, "#choices": 2**50}
    del entries["state-to-choices.bin"]
    with pytest.raises(InputError, match=r"choice-to-branches\.bin has 48 bytes, not"):
        read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward="r")
    index["transition-system"] |= {"#branches": 2**50}
    del entries["choice-to-branches.bin"]
    with pytest.raises(InputError, match=r"branch-to-target\.bin has 64 bytes, not"):
        read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward="r")


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.umb: can't be read \(No such file or directory\)"):
        read_umb(tmp_path / "nowhere.umb")
    with pytest.raises(InputError, match=r"can't be read \(Is a directory\)"):
        read_umb(tmp_path)
