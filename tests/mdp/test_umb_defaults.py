"""UMB archives that use defaults, repeated branches or rationals; Storm reads them as well."""

from __future__ import annotations

import struct
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import stormpy

from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.mdp.umb import read_umb, write_umb
from tests.support.mdp_routes import assert_identical
from tests.support.umb_example import Entries, Index, doubles, saved, standard_example, tar_bytes, words

Change = Callable[[Index, Entries], None]


def reading(tmp_path: Path, *changes: Change, reward: str | None = "r") -> TabularMDP:
    index, entries = standard_example()
    for change in changes:
        change(index, entries)
    return read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward=reward)


def entries_are(**contents: bytes) -> Change:
    return lambda _, entries: entries.update(
        {f"branch-to-{name}.bin": data for name, data in contents.items()}
    )


def leave_out(*names: str) -> Change:
    def change(_: Index, entries: Entries) -> None:
        for name in names:
            del entries[name]

    return change


def rationals(*values: str, bits: int = 64) -> bytes:
    parts = [(Fraction(value).numerator, Fraction(value).denominator) for value in values]
    size = bits // 8
    return b"".join(
        top.to_bytes(size, "little", signed=True) + bottom.to_bytes(size, "little") for top, bottom in parts
    )


def storm_probabilities(path: Path) -> list[dict[int, float]]:
    """Target -> probability of each choice, as Storm reads an archive."""
    model = stormpy.build_model_from_umb(str(path))
    matrix = model.transition_matrix
    return [
        {entry.column: float(entry.value) for entry in matrix.get_row(row)} for row in range(matrix.nr_rows)
    ]


def our_probabilities(mdp: TabularMDP) -> list[dict[int, float]]:
    found: list[dict[int, float]] = [{} for _ in range(mdp.num_choices)]
    for choice, target, prob in zip(mdp.branch_choice, mdp.branch_target, mdp.branch_prob, strict=True):
        found[choice][int(target)] = float(prob)
    return found


# The branches of the example, of the choices 0, 0, 1, 1, 2, 2, 3, 4.
TARGETS = (1, 2, 2, 3, 0, 1, 2, 3)


def test_branches_to_one_state_are_added_up(tmp_path: Path) -> None:
    mdp = reading(tmp_path, entries_are(target=words(1, 1, 2, 3, 0, 1, 2, 3)))
    assert mdp.choice_to_branch.tolist() == [0, 1, 3, 5, 6, 7]
    assert mdp.branch_target.tolist() == [1, 2, 3, 0, 1, 2, 3]
    assert mdp.branch_prob.tolist() == [1, 0.2, 0.8, 0.9, 0.1, 1, 1]
    assert our_probabilities(mdp) == storm_probabilities(tmp_path / "mdp.umb")


def test_a_branch_of_probability_0_is_dropped(tmp_path: Path) -> None:
    mdp = reading(tmp_path, entries_are(probability=doubles(0, 1, 0.2, 0.8, 1, 0, 1, 1)))
    assert our_probabilities(mdp) == [{2: 1}, {2: 0.2, 3: 0.8}, {0: 1}, {2: 1}, {3: 1}]
    # no branch leads to state 1 any more, of positive probability
    assert mdp.reachable.tolist() == [True, False, True, True]


def test_a_choice_of_nothing_but_probability_0_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"\(x=1, b=0\), action a has no successor"):
        reading(tmp_path, entries_are(probability=doubles(0.5, 0.5, 0.2, 0.8, 0, 0, 1, 1)))


def test_the_reward_of_branches_that_become_one_is_their_mean(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["annotations"]["rewards"]["r"]["applies-to"] = ["choices", "branches"]
        entries["annotations/rewards/r/branches/values.bin"] = doubles(1, 2, 8, 3, 0, 0, 5, 0)
        entries["branch-to-target.bin"] = words(1, 2, 3, 3, 1, 1, 2, 3)

    mdp = reading(tmp_path, change)
    # By hand: choice 1 earns 1, and 0.2 * 8 + 0.8 * 3 = 4 on the way to state 3.
    assert mdp.branch_reward is not None
    assert mdp.branch_target.tolist() == [1, 2, 3, 1, 2, 3]
    assert mdp.branch_reward.tolist() == pytest.approx([1, 2, 5, 0, 5, 0], abs=1e-15)
    assert mdp.choice_reward.tolist() == pytest.approx([1.5, 5, 0, 5, 0], abs=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_split_branches_are_put_together_again(tmp_path: Path, seed: int) -> None:
    """Each branch is split into parts that sum up exactly, with branches of 0 between, in any order."""
    generator = np.random.default_rng(seed)
    index, entries = standard_example()
    probs = [float(prob) for prob in np.frombuffer(entries["branch-to-probability.bin"], "<f8")]
    pointers = np.frombuffer(entries["choice-to-branches.bin"], "<u8").astype(int)
    rows = []
    for start, end in pairwise(pointers):
        parts = [(int(generator.integers(4)), 0.0) for _ in range(generator.integers(3))]
        for branch in range(start, end):
            pieces = 2 ** int(generator.integers(3))
            parts += [(TARGETS[branch], probs[branch] / pieces)] * pieces
        rows.append([parts[place] for place in generator.permutation(len(parts))])
    index["transition-system"]["#branches"] = sum(map(len, rows))
    entries["choice-to-branches.bin"] = words(*np.cumsum([0, *map(len, rows)]).tolist())
    entries["branch-to-target.bin"] = words(*(target for row in rows for target, _ in row))
    entries["branch-to-probability.bin"] = doubles(*(prob for row in rows for _, prob in row))
    path = saved(tmp_path / "split.umb", tar_bytes(index, entries))
    whole = reading(tmp_path, lambda *_: None)
    split = read_umb(path, reward="r")
    assert our_probabilities(split) == our_probabilities(whole)
    assert split.reachable.tolist() == whole.reachable.tolist()
    write_umb(split, tmp_path / "again.umb", reward="r")
    assert_identical(read_umb(tmp_path / "again.umb", reward="r"), split)
    storm = storm_probabilities(path)
    for ours, theirs in zip(our_probabilities(split), storm, strict=True):
        assert ours == pytest.approx({key: prob for key, prob in theirs.items() if prob > 0}, abs=1e-15)


def test_values_that_are_left_out_are_0_and_false(tmp_path: Path) -> None:
    mdp = reading(
        tmp_path,
        leave_out("annotations/aps/g/states/values.bin", "annotations/rewards/r/choices/values.bin"),
    )
    assert mdp.labels["g"].tolist() == [False] * 4
    assert mdp.choice_reward.tolist() == [0] * 5


@pytest.mark.parametrize("kind", ["states", "choices", "branches"])
@pytest.mark.parametrize("number", ["double", "rational"])
def test_rewards_of_every_kind_may_be_left_out(tmp_path: Path, kind: str, number: str) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["annotations"]["rewards"]["none"] = {"applies-to": [kind], "type": {"type": number}}

    mdp = reading(tmp_path, change, reward="none")
    assert mdp.choice_reward.tolist() == [0] * 5
    assert mdp.branch_reward is None or mdp.branch_reward.tolist() == [0] * 8


def test_no_annotations_at_all(tmp_path: Path) -> None:
    mdp = reading(tmp_path, lambda index, _: index.pop("annotations"), reward=None)
    assert not mdp.labels
    with pytest.raises(InputError, match="no reward structure 'r'; there are: none"):
        reading(tmp_path, lambda index, _: index.pop("annotations"))


def test_actions_without_names_are_numbered_as_storm_does(tmp_path: Path) -> None:
    mdp = reading(tmp_path, leave_out("actions/choices/strings.bin", "actions/choices/string-mapping.bin"))
    names = [mdp.action_names[action] for action in mdp.choice_action]
    labels = stormpy.build_model_from_umb(str(tmp_path / "mdp.umb")).choice_labeling
    assert [{name} for name in names] == [labels.get_labels_of_choice(choice) for choice in range(5)]
    assert names == ["a0", "a1", "a0", "a0", "a0"]


def test_actions_without_names_keep_their_numbers_and_cost_no_memory(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["transition-system"]["#choice-actions"] = 2**32 - 1
        entries["actions/choices/values.bin"] = struct.pack("<5I", 7, 2**31, 7, 7, 0)

    mdp = reading(
        tmp_path, leave_out("actions/choices/strings.bin", "actions/choices/string-mapping.bin"), change
    )
    assert mdp.action_names == ("a0", "a7", f"a{2**31}")
    assert mdp.choice_action.tolist() == [1, 2, 1, 1, 0]


def test_without_actions_the_choices_of_a_state_are_numbered(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["transition-system"]["#choice-actions"] = 0
        for name in ("values", "string-mapping", "strings"):
            del entries[f"actions/choices/{name}.bin"]

    mdp = reading(tmp_path, change)
    assert mdp.action_names == ("a0", "a1")
    assert mdp.choice_action.tolist() == [0, 1, 0, 0, 0]


def test_without_numbers_every_choice_has_the_first_action(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["transition-system"] |= {"#choices": 4, "#branches": 6}
        entries["state-to-choices.bin"] = words(0, 1, 2, 3, 4)
        entries["choice-to-branches.bin"] = words(0, 2, 4, 5, 6)
        entries["branch-to-target.bin"] = words(1, 2, 0, 1, 2, 3)
        entries["branch-to-probability.bin"] = doubles(0.5, 0.5, 0.9, 0.1, 1, 1)
        del entries["actions/choices/values.bin"]

    mdp = reading(tmp_path, change, reward=None)
    assert mdp.action_names == ("a", "b")
    assert mdp.choice_action.tolist() == [0] * 4


def test_targets_may_be_left_out_where_there_is_one_state(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["transition-system"] |= {"#states": 1, "#choices": 1, "#branches": 2, "#choice-actions": 0}
        index["annotations"] = {}
        entries.clear()
        entries["choice-to-branches.bin"] = words(0, 2)
        entries["branch-to-probability.bin"] = doubles(0.25, 0.75)
        entries["state-is-initial.bin"] = words(1)
        entries["valuations/states/valuations.bin"] = bytes(1)

    mdp = reading(tmp_path, change, reward=None)
    assert (mdp.branch_target.tolist(), mdp.branch_prob.tolist()) == ([0], [1.0])


def test_defaults_that_are_spelled_out_change_nothing(tmp_path: Path) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["transition-system"] |= {"player-names": ["robot"], "#branch-actions": 1}
        entries["state-to-player.bin"] = bytes(16)
        entries["actions/branches/values.bin"] = bytes(32)
        entries["valuations/states/valuation-to-class.bin"] = bytes(16)
        entries["annotations/notes/later/states/values.bin"] = b"of another tool"
        index["annotations"]["notes"] = {
            "later": {"applies-to": ["states"], "type": {"type": "string"}, "#strings": 1}
        }

    assert_identical(reading(tmp_path, change), reading(tmp_path, lambda *_: None))


@pytest.mark.parametrize("bits", [64, 128, 4096])
def test_rationals_are_rounded_once(tmp_path: Path, bits: int) -> None:
    probs = ("1/3", "2/3", "1/5", "4/5", "9/10", "1/10", "1", "1")
    rewards = ("-1/3", "-7", f"{2**62 + 1}/{2**62 - 1}", "0", "5/7")

    def change(index: Index, entries: Entries) -> None:
        kind = {"type": "rational"} if bits == 64 else {"type": "rational", "size": 2 * bits}
        index["transition-system"]["branch-probability-type"] = kind
        index["annotations"]["rewards"]["r"]["type"] = kind
        entries["branch-to-probability.bin"] = rationals(*probs, bits=bits)
        entries["annotations/rewards/r/choices/values.bin"] = rationals(*rewards, bits=bits)

    mdp = reading(tmp_path, change)
    assert mdp.branch_prob.tolist() == [float(Fraction(prob)) for prob in probs]
    assert mdp.choice_reward.tolist() == [float(Fraction(reward)) for reward in rewards]
    if bits == 64:
        for ours, theirs in zip(
            our_probabilities(mdp), storm_probabilities(tmp_path / "mdp.umb"), strict=True
        ):
            assert ours == pytest.approx(theirs, abs=1e-15)


@pytest.mark.parametrize("number", [struct.pack("<qQ", 1, 0), struct.pack("<qQ", 0, 0)])
def test_a_fraction_over_0_is_refused(tmp_path: Path, number: bytes) -> None:
    def change(index: Index, entries: Entries) -> None:
        index["annotations"]["rewards"]["r"]["type"] = {"type": "rational"}
        entries["annotations/rewards/r/choices/values.bin"] = number * 5

    with pytest.raises(InputError, match=r"r/choices/values\.bin has a value that is no number"):
        reading(tmp_path, change)


def test_an_alias_may_be_empty(tmp_path: Path) -> None:
    def change(index: Index, _: Entries) -> None:
        index["annotations"]["aps"]["g"]["alias"] = ""

    assert list(reading(tmp_path, change).labels) == [""]
