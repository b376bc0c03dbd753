"""The text is read back with the grammar of expressions: the second route to what it means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merap.concerns.space import Space
from merap.mdp.model import Ints
from merap.prism import location_text
from merap.prism.location_text import cases, predicate
from merap.program.expressions import evaluate, parse
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


def meaning(text: str, space: Space) -> npt.NDArray[np.generic]:
    """The value of the text at every location."""
    scope = dict(zip(space.variable_names, space.valuations.T, strict=True))
    return np.broadcast_to(evaluate(parse(text), scope), space.num_locations)


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


@given(labelled_spaces(values=2), st.sampled_from([1, 3, 64]))
def test_a_predicate_holds_in_its_locations(labelled: tuple[Space, Ints], chain: int) -> None:
    space, values = labelled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(location_text, "MAX_CHAIN", chain)
        text = predicate(space, values == 1)
    assert np.array_equal(meaning(text, space), values == 1)
    # so that it can stand beside & and | and after !
    assert np.array_equal(
        meaning(f"!{text} & true" if text[0] == "(" else f"!({text}) & true", space), values == 0
    )


@given(labelled_spaces(values=4), st.sampled_from([1, 3, 64]))
def test_cases_give_each_location_its_text(labelled: tuple[Space, Ints], chain: int) -> None:
    space, index = labelled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(location_text, "MAX_CHAIN", chain)
        text = cases(space, ["10", "-11", "(5 + 7)", "13"], index)
    expected = np.array([10, -11, 12, 13])[index]
    assert np.array_equal(meaning(text, space), expected)
    # so that it can be a factor
    assert np.array_equal(meaning(f"2 * {text}" if text[0] != "-" else f"2 * ({text})", space), 2 * expected)


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        ([], "false"),
        (range(12), "true"),
        ([0], "(row=0 & col=0)"),
        ([0, 1, 2, 3], "row=0"),
        ([1, 2, 3, 5, 6, 7], "(row<=1 & col>=1)"),
        ([3, 7, 11], "col=3"),
        ([0, 11], "((row=0 & col=0) | (row=2 & col=3))"),
        ([0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11], "!(row=1 & col=0)"),
        ([5, 6, 9, 10], "(row>=1 & col>=1 & col<=2)"),
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
        ([2, 3, 4], "(loc>=2 & loc<=4)"),
        ([1, 3], "(loc=1 | loc=3)"),
        ([0, 1, 2, 4, 5, 6, 7, 8, 9], "!(loc=3)"),
    ],
)
def test_locations_of_a_graph_are_written_as_runs(chosen: list[int], text: str) -> None:
    mask = np.zeros(10, dtype=np.bool_)
    mask[chosen] = True
    assert predicate(line(10), mask) == text


def test_the_most_frequent_case_comes_last_and_needs_no_condition() -> None:
    index = np.array([1, 0, 0, 0, 2, 0, 2, 0, 0, 0])
    assert cases(line(10), ["7", "8", "9"], index) == "(loc=0 ? 8 : loc=4 | loc=6 ? 9 : 7)"
    assert cases(line(10), ["7"], np.zeros(10, dtype=np.int64)) == "7"


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
    index = np.arange(size)[::-1].copy()
    text = cases(space, [str(value) for value in range(size)], index)
    deepest = max(np.cumsum([(char == "(") - (char == ")") for char in text]))
    # halved until no more than MAX_CHAIN links are left: ceil(log2(2000 / 64)) = 5 times
    assert deepest <= 7
    assert len(text) < 20 * size
    every_other = predicate(space, index % 2 == 0)
    assert max(np.cumsum([(char == "(") - (char == ")") for char in every_other])) <= 7
