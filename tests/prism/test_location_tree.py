"""Trees over the location: their text is read back with the grammar of expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import merap.prism.location_tree
from merap.concerns.space import Space
from merap.mdp.model import Bools, Ints
from merap.prism.engine_text import text_of
from merap.prism.location_tree import location_tree
from merap.program.expressions import Constant, Expression, Value, evaluate, parse
from tests.support.hand_made import cells, graph_combination, grid_space

GRID = grid_space((3, 4))


def line(size: int) -> Space:
    """A graph with that many locations."""
    return replace(
        graph_combination().space,
        locations=tuple(f"n{index}" for index in range(size)),
        positions=np.zeros((size, 2)),
        target=np.zeros((size, 3), dtype=np.int64),
    )


def meaning(tree: Expression, space: Space) -> npt.NDArray[np.generic]:
    """The value of the tree's text at every location."""
    scope = dict(zip(space.variable_names, space.valuations.T, strict=True))
    return np.broadcast_to(evaluate(parse(text_of(tree)), scope), space.num_locations)


@st.composite
def spaces(draw: st.DrawFn) -> Space:
    if draw(st.booleans()):
        return line(draw(st.integers(1, 40)))
    return grid_space((draw(st.integers(1, 7)), draw(st.integers(1, 7))))


@st.composite
def labelled_spaces(draw: st.DrawFn, values: int) -> tuple[Space, Ints]:
    space = draw(spaces())
    size = space.num_locations
    return space, np.array(draw(st.lists(st.integers(0, values - 1), min_size=size, max_size=size)))


def tree_of(space: Space, index: Ints, leaves: Sequence[Value]) -> Expression:
    shape = space.shape or (1, space.num_locations)
    used, inverse = np.unique(index, return_inverse=True)
    constants = [Constant(leaves[number]) for number in used.tolist()]
    names = space.variable_names
    return location_tree(names, [0] * len(names), inverse.reshape(shape), constants)


def predicate(space: Space, mask: Bools) -> str:
    return text_of(tree_of(space, mask.astype(np.int64), (False, True)))


@given(labelled_spaces(values=2), st.sampled_from([1, 3, 64]))
def test_a_predicate_holds_in_its_locations(labelled: tuple[Space, Ints], chain: int) -> None:
    space, values = labelled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merap.prism.location_tree, "MAX_CHAIN", chain)
        tree = tree_of(space, values, (False, True))
    assert np.array_equal(meaning(tree, space), values == 1)


@given(labelled_spaces(values=4), st.sampled_from([1, 3, 64]))
def test_cases_give_each_location_its_value(labelled: tuple[Space, Ints], chain: int) -> None:
    space, index = labelled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merap.prism.location_tree, "MAX_CHAIN", chain)
        tree = tree_of(space, index, [Fraction(value) for value in (10, -11, 12, 13)])
    assert np.array_equal(meaning(tree, space), np.array([10, -11, 12, 13])[index])


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        ([], "false"),
        (range(12), "true"),
        ([0], "row=0 & col=0"),
        ([0, 1, 2, 3], "row=0"),
        ([1, 2, 3, 5, 6, 7], "row<=1 & col>=1"),
        ([3, 7, 11], "col=3"),
        ([0, 11], "row=0 & col=0 | row=2 & col=3"),
        ([0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11], "!(row=1 & col=0)"),
        ([5, 6, 9, 10], "row>=1 & col>=1 & col<=2"),
    ],
)
def test_cells_are_written_as_boxes(chosen: list[int], text: str) -> None:
    mask = np.zeros(12, dtype=np.bool_)
    mask[list(chosen)] = True
    assert predicate(GRID, mask) == text


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        ([3], "loc=3"),
        ([0, 1, 2], "loc<=2"),
        ([8, 9], "loc>=8"),
        ([2, 3, 4], "loc>=2 & loc<=4"),
        ([1, 3], "loc=1 | loc=3"),
        ([0, 1, 2, 4, 5, 6, 7, 8, 9], "!(loc=3)"),
    ],
)
def test_locations_of_a_graph_are_written_as_runs(chosen: list[int], text: str) -> None:
    mask = np.zeros(10, dtype=np.bool_)
    mask[chosen] = True
    assert predicate(line(10), mask) == text


def test_the_most_frequent_case_comes_last_and_needs_no_condition() -> None:
    index = np.array([1, 0, 0, 0, 2, 0, 2, 0, 0, 0])
    values = [Fraction(7), Fraction(8), Fraction(9)]
    assert text_of(tree_of(line(10), index, values)) == "loc=0 ? 8 : loc=4 | loc=6 ? 9 : 7"
    assert text_of(tree_of(line(10), 0 * index, values)) == "7"


def test_a_single_location_needs_no_condition() -> None:
    assert predicate(line(1), np.array([True])) == "true"
    assert predicate(grid_space((1, 3)), np.array([False, True, True])) == "col>=1"
    assert predicate(grid_space((3, 1)), np.array([False, True, False])) == "row=1"


def test_obstacles_are_not_written_cell_by_cell() -> None:
    # two walls of 9 cells and a block of 9 are three boxes
    walls = [(1, col) for col in range(9)] + [(row, 4) for row in range(2, 9)]
    block = [(row, col) for row in (5, 6, 7) for col in (6, 7, 8)]
    assert predicate(grid_space(), cells(*walls, *block)).count("|") == 2


def test_a_long_chain_becomes_a_tree() -> None:
    size = 2000
    space = line(size)
    text = text_of(tree_of(space, np.arange(size)[::-1].copy(), [Fraction(value) for value in range(size)]))
    # halved until no more than MAX_CHAIN links are left: ceil(log2(2000 / 64)) = 5 times
    assert deepest(text) <= 7
    assert len(text) < 20 * size
    assert deepest(predicate(space, np.arange(size) % 2 == 0)) <= 7


def deepest(text: str) -> int:
    return int(max(np.cumsum([(char == "(") - (char == ")") for char in text])))
