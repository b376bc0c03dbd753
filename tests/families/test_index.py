"""Which states the index of a case holds."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from merap.families.index import family_index, index_kinds
from merap.families.loading import load_case
from merap.families.models import explored
from merap.families.observation import VariableKind
from merap.mdp.model import TabularMDP
from merap.program.form import Program
from tests.support.hand_made import graph_combination
from tests.support.mdp_examples import Choices, make_mdp
from tests.support.paths import MODELS
from tests.support.programs import process_of

WIDE = VariableKind("level", "coordinate", -2, 4)


def chain(*levels: int) -> TabularMDP:
    """From each level to the next one, and at last to a complete state of level 0."""
    following = [*((level, 0) for level in levels[1:]), (0, 1)]
    steps: Choices = {
        (level, 0): {"go": (1.0, {there: 1.0})} for level, there in zip(levels, following, strict=True)
    }
    return make_mdp(
        {**steps, (0, 1): {"end": (0.0, {(0, 1): 1.0})}},
        variables=("level", "done"),
        labels={"done": {(0, 1)}},
    )


def test_every_valuation_is_on_the_index_where_members_reach_many() -> None:
    index = family_index([WIDE], ("go",), [chain(3), chain(-1)])  # 2 of 7
    assert index.valuations[1:, 0].tolist() == [-2, -1, 0, 1, 2, 3, 4]


def test_only_those_reached_are_on_the_index_where_members_reach_few() -> None:
    index = family_index([WIDE], ("go",), [chain(3)])  # 1 of 7
    assert index.valuations[1:, 0].tolist() == [3]
    assert index.extended(chain(-1, 3)).valuations[1:, 0].tolist() == [3, -1]


def test_locations_and_modes_are_in_the_order_of_the_case() -> None:
    case = load_case(MODELS / "running-example")
    members = list(case.combinations())
    kinds = index_kinds([one.program for one in members])
    index = family_index(kinds, case.actions, [explored(one) for one in members])
    size = [kind.high + 1 for kind in kinds]
    assert index.valuations[len(index.completed) :].tolist() == [
        list(cell) for cell in product(*map(range, size))
    ]


def test_kinds_of_a_graph() -> None:
    assert index_kinds([graph_combination().program]) == (
        VariableKind("loc", "category", 0, 3),
        VariableKind("mode", "category", 0, 2),
    )


def test_the_flag_is_left_out_where_other_variables_tell_states_apart() -> None:
    flagged = Program("p", (process_of(x=(0, 2)), process_of(done=(0, 1))), flag="done")
    assert [kind.name for kind in index_kinds([flagged])] == ["x"]
    assert [kind.name for kind in index_kinds([replace(flagged, flag=None)])] == ["x", "done"]


def test_an_only_variable_stays() -> None:
    program = Program("p", (process_of(done=(0, 1)),), flag="done")
    assert [kind.name for kind in index_kinds([program])] == ["done"]


def test_ranges_are_those_of_all_members() -> None:
    short, long = (Program("p", (process_of(x=bounds),)) for bounds in ((1, 2), (-3, 1)))
    assert index_kinds([short, long]) == (VariableKind("x", "coordinate", -3, 2),)
