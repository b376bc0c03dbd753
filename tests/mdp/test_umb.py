"""UMB archives: read, written, given to Storm and taken from it."""

from __future__ import annotations

import gzip
import json
import lzma
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stormpy

from merap.errors import InputError, ModelError, OutputError
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.mdp.umb import read_umb, write_umb
from merap.mdp.umb_encoding import encode
from tests.support.mdp_examples import (
    corner_grid,
    large_grid,
    make_mdp,
    puterman_two_states,
    random_mdp,
    whole_paper_grid,
)
from tests.support.mdp_routes import assert_identical
from tests.support.storm_runs import storm_values
from tests.support.umb_example import doubles, saved, standard_example, tar_bytes, words


@pytest.mark.parametrize("compress", [bytes, gzip.compress, lzma.compress])
def test_the_standards_example(tmp_path: Path, compress: Callable[[bytes], bytes]) -> None:
    mdp = read_umb(saved(tmp_path / "mdp.umb", compress(tar_bytes(*standard_example()))), reward="r")
    assert mdp.variable_names == ("x", "b")
    assert mdp.valuations.tolist() == [[0, 0], [1, 0], [2, 0], [2, 1]]
    assert mdp.action_names == ("a", "b")
    assert mdp.choice_action.tolist() == [0, 1, 0, 0, 0]
    assert mdp.state_to_choice.tolist() == [0, 2, 3, 4, 5]
    assert mdp.branch_target.tolist() == [1, 2, 2, 3, 0, 1, 2, 3]
    assert mdp.branch_prob.tolist() == [0.5, 0.5, 0.2, 0.8, 0.9, 0.1, 1, 1]
    assert mdp.choice_reward.tolist() == [0, 1, 0, 0, 0]
    assert mdp.labels["g"].tolist() == [False, False, False, True]
    assert mdp.initial.tolist() == [1, 0, 0, 0]
    assert mdp.reachable.all()
    assert mdp.branch_reward is None


def test_the_reward_structure_is_a_choice(tmp_path: Path) -> None:
    path = saved(tmp_path / "mdp.umb", tar_bytes(*standard_example()))
    assert read_umb(path, reward=None).choice_reward.tolist() == [0] * 5
    with pytest.raises(InputError, match=r"no reward structure 'objective'; there are: r"):
        read_umb(path)


def test_rewards_of_states_choices_and_branches_add_up(tmp_path: Path) -> None:
    index, entries = standard_example()
    index["annotations"]["rewards"]["r"]["applies-to"] = ["states", "choices", "branches"]
    entries["annotations/rewards/r/states/values.bin"] = doubles(10, 20, 30, 40)
    entries["annotations/rewards/r/branches/values.bin"] = doubles(2, 4, 0, 5, 1, 11, 0, 3)
    mdp = read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward="r")
    # By hand, as 10 + 1 + (0.2 * 0 + 0.8 * 5) for the second choice.
    assert mdp.choice_reward.tolist() == pytest.approx([13, 15, 22, 30, 43], abs=1e-12)
    assert mdp.branch_reward is not None
    assert mdp.branch_reward.tolist() == [12, 14, 11, 16, 21, 31, 30, 43]


def test_rows_are_one_to_one_where_the_archive_leaves_pointers_out(tmp_path: Path) -> None:
    index, entries = standard_example()
    system = index["transition-system"]
    system |= {"#players": 0, "#choices": 4, "#branches": 4, "#choice-actions": 0, "#initial-states": 2}
    del index["annotations"]["rewards"]
    entries = {name: data for name, data in entries.items() if name.startswith(("ann", "val"))}
    entries |= {
        "branch-to-target.bin": words(1, 1, 3, 3),
        "branch-to-probability.bin": doubles(1, 1, 1, 1),
        "state-is-initial.bin": words(0b0101),
    }
    mdp = read_umb(saved(tmp_path / "chain.umb", tar_bytes(index, entries)), reward=None)
    assert mdp.state_to_choice.tolist() == mdp.choice_to_branch.tolist() == [0, 1, 2, 3, 4]
    assert mdp.action_names == ("step",)
    assert mdp.initial.tolist() == [0.5, 0, 0.5, 0]


def test_reachability_is_computed(tmp_path: Path) -> None:
    index, entries = standard_example()
    entries["state-is-initial.bin"] = words(0b0100)
    mdp = read_umb(saved(tmp_path / "mdp.umb", tar_bytes(index, entries)), reward="r")
    assert mdp.reachable.tolist() == [False, False, True, False]


def full_range_mdp() -> TabularMDP:
    """Valuations of every width, labels and actions with awkward names, odd rewards."""
    far = 2**63 - 1
    states = [(0, -5, far, 1), (1, 250, -far - 1, 1), (1, -5, 3, 70_000), (0, 0, 0, -(2**40))]
    mdp = make_mdp(
        {
            states[0]: {
                "go on": (0.1, {states[1]: 1 / 3, states[3]: 2 / 3}),
                "Ünder": (-1e300, {states[0]: 1}),
            },
            states[1]: {"": (0.0, {states[2]: 1.0})},
            states[2]: {"go on": (5e-324, {states[0]: 1.0})},
            states[3]: {"go on": (0.0, {states[3]: 1.0})},
        },
        variables=("flag", "small", "wide", "offset"),
        actions=("never", "go on", "Ünder", ""),
        initial={states[0]: 0.25, states[1]: 0.75},
        labels={"Goal": {states[3]}, "goal": {states[0]}, "far away!": set(), "ap-1": set(states)},
    )
    return replace(mdp, branch_reward=np.array([0.3, 0.0, -1e300, 0.0, 5e-324, 0.0]))


@pytest.mark.parametrize(
    "mdp",
    [puterman_two_states(), corner_grid(), whole_paper_grid(slip=0.1), full_range_mdp()]
    + [random_mdp(np.random.default_rng(seed)) for seed in range(5)],
)
def test_what_is_written_is_read_back_identically(tmp_path: Path, mdp: TabularMDP) -> None:
    whole = restrict_to_reachable(mdp)
    write_umb(whole, tmp_path / "one.umb", reward="pay-off")
    copy = read_umb(tmp_path / "one.umb", reward="pay-off")
    assert_identical(copy, whole)
    write_umb(copy, tmp_path / "two.umb", reward="pay-off")
    assert (tmp_path / "two.umb").read_bytes() == (tmp_path / "one.umb").read_bytes()


def test_big_arrays_are_used_in_place(tmp_path: Path) -> None:
    write_umb(puterman_two_states(), str(tmp_path / "mdp.umb"))
    mdp = read_umb(str(tmp_path / "mdp.umb"))
    for name in ("branch_target", "branch_prob", "choice_to_branch", "state_to_choice", "choice_reward"):
        array = getattr(mdp, name)
        while isinstance(array.base, np.ndarray):
            array = array.base
        assert isinstance(array.base, memoryview), name
        assert type(array.base.obj).__name__ == "mmap", name


def test_a_replaced_file_leaves_the_model_that_was_read_from_it(tmp_path: Path) -> None:
    path = tmp_path / "mdp.umb"
    write_umb(puterman_two_states(), path)
    mdp = read_umb(path)
    with pytest.raises(OutputError, match=r"mdp\.umb is already there"):
        write_umb(corner_grid(), path)
    write_umb(corner_grid(), path, overwrite=True)
    assert_identical(mdp, puterman_two_states())
    assert_identical(read_umb(path), corner_grid())
    assert [entry.name for entry in tmp_path.iterdir()] == ["mdp.umb"]


def test_what_cannot_be_written(tmp_path: Path) -> None:
    two = puterman_two_states()
    empty = make_mdp({(0,): {"stay": (0.0, {(0,): 1.0})}, (1,): {}})
    path = tmp_path / "mdp.umb"
    with pytest.raises(ModelError, match=r"state \(s=1\) has no action; restrict"):
        write_umb(empty, path)
    with pytest.raises(ModelError, match=r"state \(s=1\) has 2 actions, a Markov chain allows 1"):
        write_umb(two, path, as_chain=True)
    with pytest.raises(ModelError, match="label 'init' is reserved"):
        write_umb(replace(two, labels={"init": np.array([True, False])}), path)
    with pytest.raises(OutputError, match="No such file or directory"):
        write_umb(two, tmp_path / "nowhere" / "mdp.umb")
    assert list(tmp_path.iterdir()) == []


# Storm as the second route.


def from_storm(tmp_path: Path, text: str, *, out_of_bounds_state: bool = True) -> Path:
    source = tmp_path / "model.prism"
    source.write_text(text)
    options = stormpy.BuilderOptions()
    options.set_build_all_reward_models(True)
    options.set_build_all_labels(True)
    options.set_build_choice_labels(True)
    options.set_build_state_valuations(True)
    options.set_add_out_of_bounds_state(out_of_bounds_state)
    program = stormpy.parse_prism_program(str(source), prism_compatibility=True)
    umb_options = stormpy.io.UmbExportOptions()
    umb_options.compression = stormpy.io.CompressionMode.NO_COMPRESSION
    umb = stormpy.io.sparse_model_to_umb(stormpy.build_model(program, options=options), options=umb_options)
    stormpy.io.umb_to_archive(umb, str(tmp_path / "storm.umb"), umb_options)
    return tmp_path / "storm.umb"


STORM_TEXT = """mdp
module m
  x : [-2..5] init -2;
  big : [100..1000] init 250;
  b : bool init true;
  [up] x<1 -> 4/5 : (x'=x+1) + 1/5 : (b'=!b);
  [stay] x=1 -> (big'=700);
  [stay] x<1 & b -> true;
endmodule
label "top" = x=1;
rewards "objective" [up] true : -1/2; x=0 : 3; endrewards
"""


@pytest.mark.parametrize("out_of_bounds_state", [True, False])
def test_a_model_built_by_storm(tmp_path: Path, out_of_bounds_state: bool) -> None:
    path = from_storm(tmp_path, STORM_TEXT, out_of_bounds_state=out_of_bounds_state)
    mdp = read_umb(path)
    assert set(mdp.variable_names) == {"x", "big", "b"}
    x, big, b = (mdp.valuations[:, mdp.variable_names.index(name)] for name in ("x", "big", "b"))
    # By hand: x in -2..1 with b either way; from x = 1 on big becomes 700.
    expected = {(value, 250, flag) for value in range(-2, 2) for flag in (0, 1)}
    expected |= {(1, 700, flag) for flag in (0, 1)}
    assert set(zip(x.tolist(), big.tolist(), b.tolist(), strict=True)) == expected
    assert mdp.labels["top"].tolist() == (x == 1).tolist()
    assert mdp.initial.tolist() == ((x == -2) & (b == 1)).astype(float).tolist()
    names = np.array(mdp.action_names)[mdp.choice_action]
    state_reward = np.where(x[mdp.choice_state] == 0, 3.0, 0.0)
    assert mdp.choice_reward.tolist() == (state_reward - 0.5 * (names == "up")).tolist()
    at_two = np.flatnonzero((x == -2) & (b == 1))[0]
    assert {names[choice] for choice in np.flatnonzero(mdp.choice_state == at_two)} == {"up", "stay"}


def test_a_variable_out_of_range_is_refused(tmp_path: Path) -> None:
    path = from_storm(tmp_path, STORM_TEXT.replace("x<1 ->", "x<9 ->"))
    with pytest.raises(ModelError, match="an update takes a variable out of its range"):
        read_umb(path)


def test_unnamed_commands_are_allowed_once_a_state(tmp_path: Path) -> None:
    once = STORM_TEXT.replace("[stay] x=1", "[] x=1")
    assert "" in read_umb(from_storm(tmp_path, once)).action_names
    with pytest.raises(ModelError, match=r"action \(unnamed\) is there twice"):
        read_umb(from_storm(tmp_path, once.replace("endmodule", "[] x=1 -> true; endmodule")))


def test_storm_reads_states_labels_and_actions(tmp_path: Path) -> None:
    mdp = whole_paper_grid(slip=0.1)
    write_umb(mdp, tmp_path / "mdp.umb")
    model = stormpy.build_model_from_umb(str(tmp_path / "mdp.umb"))
    assert (model.nr_states, model.nr_choices, model.nr_transitions) == (
        mdp.num_states,
        mdp.num_choices,
        mdp.num_branches,
    )
    assert list(model.initial_states) == np.flatnonzero(mdp.initial).tolist()
    assert model.labeling.get_labels() == {"init", "done", "goal"}
    for name, mask in mdp.labels.items():
        assert list(model.labeling.get_states(name)) == np.flatnonzero(mask).tolist()
    for choice in range(0, mdp.num_choices, 7):
        name = mdp.action_names[mdp.choice_action[choice]]
        assert model.choice_labeling.get_labels_of_choice(choice) == {name}
    for state in range(0, mdp.num_states, 5):
        valuation = json.loads(str(model.state_valuations.to_json(state)))
        assert [valuation[name] for name in mdp.variable_names] == mdp.valuations[state].tolist()


def test_labels_with_awkward_names_are_all_kept_for_storm_too(tmp_path: Path) -> None:
    names = ("a-2", "a", "A", "a-3", "", "é", "É", "x" * 300, "x" * 301)
    labels = {name: np.array([bool(number & 1), bool(number & 2)]) for number, name in enumerate(names)}
    write_umb(replace(puterman_two_states(), labels=labels), tmp_path / "mdp.umb")
    mdp = read_umb(tmp_path / "mdp.umb")
    storm = stormpy.build_model_from_umb(str(tmp_path / "mdp.umb")).labeling
    for name, mask in labels.items():
        assert mdp.labels[name].tolist() == mask.tolist()
        assert list(storm.get_states(name)) == np.flatnonzero(mask).tolist()
    with tarfile.open(tmp_path / "mdp.umb") as tar:
        entries = [entry.casefold() for entry in tar.getnames()]
    assert len(set(entries)) == len(entries)


@pytest.mark.parametrize("branch_rewards", [False, True])
def test_storm_and_backward_induction_agree(tmp_path: Path, branch_rewards: bool) -> None:
    mdp = whole_paper_grid(slip=0.1, blocked=[(1, 2), (3, 2), (4, 1), (6, 1)])
    if branch_rewards:
        mdp = replace(mdp, branch_reward=mdp.choice_reward[mdp.branch_choice])
    write_umb(mdp, tmp_path / "mdp.umb")
    start = int(np.flatnonzero(mdp.initial)[0])
    for discount, bound in ((1.0, "18"), (0.95, "18discount=0.95")):
        best = storm_values(tmp_path / "mdp.umb", f'R{{"objective"}}max=? [C<={bound}]')[start]
        worst = storm_values(tmp_path / "mdp.umb", f'R{{"objective"}}min=? [C<={bound}]')[start]
        assert optimum(mdp, 18, discount) == pytest.approx(best, abs=1e-9)
        assert worst_value(mdp, 18, discount) == pytest.approx(worst, abs=1e-9)


def test_a_large_model(tmp_path: Path) -> None:
    mdp = large_grid(450)  # 202,500 states, 1.6 million branches
    write_umb(mdp, tmp_path / "large.umb")
    assert_identical(read_umb(tmp_path / "large.umb"), mdp)
    assert stormpy.build_model_from_umb(str(tmp_path / "large.umb")).nr_states == 202_500


def test_entries_have_deterministic_order_and_the_index_comes_first() -> None:
    names = list(encode(full_range_mdp(), "objective", as_chain=False))
    assert names[0] == "index.json"
    assert len(names) == len(set(names))
