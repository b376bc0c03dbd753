from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from merap.errors import ModelError
from merap.families.index import index_kinds
from merap.families.observation import VariableKind, model_kinds, observation_features, variable_kind
from merap.mdp.gymnasium_import import import_gymnasium, import_table
from merap.mdp.model import Ints
from merap.program.form import boolean, integer
from tests.support.grid_tasks import grid_model, grid_task
from tests.support.hand_made import graph_combination, grid_combination
from tests.support.learning_examples import ring_models
from tests.support.placed import model_of

COORDINATE = VariableKind("row", "coordinate", 2, 6)


def features_of(kinds: Sequence[VariableKind], valuations: Ints) -> npt.NDArray[np.float32]:
    return observation_features(kinds, valuations, np.zeros(len(valuations), dtype=np.bool_))


def test_a_flag_is_itself_and_a_category_one_hot() -> None:
    kinds = (VariableKind("lit", "flag", 0, 1), VariableKind("mode", "category", 0, 2))
    found = features_of(kinds, np.array([[0, 1], [1, 0], [1, 2]]))
    assert found.tolist() == [[0, 0, 1, 0], [1, 1, 0, 0], [1, 0, 0, 1]]


def test_a_coordinate_by_hand() -> None:
    """Half way up from 2 to 6: two steps are half a turn of wavelength 4 and a quarter of 8."""
    found = features_of([COORDINATE], np.array([[4]]))[0]
    assert found[0] == 0.5
    sines, cosines = found[1:].reshape(2, -1)
    np.testing.assert_allclose(sines[:2], [0, 1], atol=1e-6)
    np.testing.assert_allclose(cosines[:2], [-1, 0], atol=1e-6)


def test_what_a_single_value_tells_is_nothing() -> None:
    assert VariableKind("mode", "category", 0, 0).num_features == 0
    assert features_of([VariableKind("mode", "category", 0, 0), COORDINATE], np.array([[0, 2]])).shape == (
        1,
        COORDINATE.num_features,
    )


def test_the_completed_state_has_no_features() -> None:
    kinds = (COORDINATE, VariableKind("mode", "category", 0, 2))
    found = observation_features(kinds, np.array([[2, 1], [2, 1]]), np.array([False, True]))
    assert found[0].any()
    assert not found[1].any()


@given(st.integers(2, 250), st.integers(2, 250))
def test_states_of_a_grid_are_told_apart_whatever_its_size(rows: int, cols: int) -> None:
    kinds = (VariableKind("row", "coordinate", 0, rows - 1), VariableKind("col", "coordinate", 0, cols - 1))
    cells = np.stack([np.arange(max(rows, cols)) % rows, np.arange(max(rows, cols)) % cols], axis=1)
    found = features_of(kinds, cells)
    assert found.shape[1] == sum(kind.num_features for kind in kinds)
    assert found.shape[1] == 2 * COORDINATE.num_features
    assert pdist(found).min() > 0.02


def test_near_values_look_more_alike_than_far_ones() -> None:
    found = features_of([VariableKind("row", "coordinate", 0, 8)], np.arange(9)[:, np.newaxis])
    from_first = np.linalg.norm(found - found[0], axis=1)
    assert from_first[1] < from_first[2] < from_first[8]


def test_kinds_of_variables() -> None:
    stage = replace(integer("stage", 0, 1), kind="named", values=("none", "got"))
    assert list(map(variable_kind, (boolean("lit"), integer("row", -1, 3), stage))) == [
        VariableKind("lit", "flag", 0, 1),
        VariableKind("row", "coordinate", -1, 3),
        VariableKind("stage", "category", 0, 1),
    ]


def test_kinds_of_a_model_are_those_of_its_case_as_far_as_it_tells() -> None:
    assert model_kinds(ring_models()[0]) == index_kinds([graph_combination().program])
    small = grid_combination(size=2, goal=(1, 1))  # rows 0 and 1 are no flags
    assert model_kinds(model_of(small)) == index_kinds([small.program])
    assert [kind.scale for kind in model_kinds(grid_model(grid_task((4, 4))))] == ["coordinate", "coordinate"]


def test_kinds_of_an_imported_model() -> None:
    taxi = model_kinds(import_gymnasium("Taxi-v4"))
    assert [kind.scale for kind in taxi] == ["coordinate", "coordinate", "category", "category"]
    assert [(kind.low, kind.high) for kind in taxi] == [(0, 4), (0, 4), (0, 4), (0, 3)]
    table = {0: {0: [(1.0, 1, 0.0, False)]}, 1: {0: [(1.0, 1, 0.0, True)]}}
    assert model_kinds(import_table(table, [1.0, 0.0])) == (VariableKind("state", "category", 0, 1),)


def test_a_value_out_of_range_is_named() -> None:
    with pytest.raises(ModelError, match=r"^row is 7, allowed is 2\.\.6$"):
        features_of([COORDINATE], np.array([[3], [7]]))
