"""Generated and named configurations: counts, order, names and back."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.concerns.generation import Choice, Product, draw, rank_of, separators, unrank
from merap.concerns.reachability import leaves_goals_reachable, reachable
from merap.concerns.space import passable
from merap.concerns.supports import Generated
from merap.errors import InputError
from tests.support.case_examples import GRAPH, GRID, replaced, write_case

BLOCKED = "choose: 2, from: {rows: [0, 1], cols: [0, 2]}, except: [[0, 0]]"


@pytest.fixture
def grid(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, GRID))


def load_grid(folder: Path, *replacements: tuple[str, str]) -> DeclaredCase:
    text = GRID[: GRID.index("online:")]
    for old, new in replacements:
        text = replaced(text, old, new)
    return load_declared_case(write_case(folder, text))


@pytest.mark.parametrize(("total", "size"), [(1, 1), (5, 2), (7, 3), (6, 6), (8, 0)])
def test_ranks_follow_itertools(total: int, size: int) -> None:
    """`itertools.combinations` lists combinations in lexicographic order."""
    for rank, positions in enumerate(itertools.combinations(range(total), size)):
        assert unrank(total, size, rank) == positions
        assert rank_of(total, positions) == rank


def choice(count: int, sizes: range | None, parameter: str = "blocked") -> Choice:
    labels = tuple(f"r0c{index}" for index in range(count))
    return Choice(parameter, tuple(range(count)), labels, sizes, "_")


@settings(deadline=None, max_examples=60)
@given(
    counts=st.lists(st.tuples(st.integers(1, 6), st.integers(0, 3)), min_size=1, max_size=3),
    data=st.data(),
)
def test_product_ranks_are_a_bijection(counts: list[tuple[int, int]], data: st.DataObject) -> None:
    choices = [
        choice(count, range(1, min(size, count) + 1) if size else None, f"p{index}")
        for index, (count, size) in enumerate(counts)
    ]
    product = Product(tuple(choices), "__")
    everything = list(product.all_values())
    assert product.count == len(everything)
    rank = data.draw(st.integers(0, product.count - 1))
    assert product.values(rank) == everything[rank]
    assert product.rank_of_values(everything[rank]) == rank
    assert product.rank_of_name(product.name(rank)) == rank


def test_names_are_distinct_and_wrong_names_are_not_found() -> None:
    product = Product((choice(5, range(2, 3)), choice(3, None, "goal")), "__")
    names = [product.name(rank) for rank in range(product.count)]
    assert len(set(names)) == product.count == 30
    assert names[0] == "blocked_r0c0_r0c1__goal_r0c0"
    for wrong in ("", "blocked_r0c0_r0c1", "blocked_r0c1_r0c0__goal_r0c0", "blocked_r0c0_r0c0__goal_r0c0",
                  "blocked_r0c0_r0c9__goal_r0c0", "other_r0c0_r0c1__goal_r0c0"):  # fmt: skip
        assert product.rank_of_name(wrong) is None


def test_long_names_are_numbered() -> None:
    """40 labels of four letters would not fit into a file name with two more configurations."""
    large = Product((choice(50, range(40, 41)),), "__")
    last = large.count - 1
    assert last == math.comb(50, 40) - 1
    assert large.name(last) == f"blocked_number{last}"
    assert large.rank_of_name(f"blocked_number{last}") == last
    assert large.rank_of_name(f"blocked_number{large.count}") is None
    assert large.rank_of_name("blocked_number007") is None


def test_separators_keep_names_readable_back() -> None:
    assert separators(["r0c0", "B"]) == ("_", "__")
    assert separators(["hall_west", "B"]) == ("__", "___")
    with pytest.raises(InputError, match="'hall_'"):
        separators(["hall_", "B"])


def test_generated_supports_are_listed_in_order(grid: DeclaredCase) -> None:
    assert grid.shape == (4, 2, 2)
    # Of the 10 pairs of 5 cells, 4 hold the goal (0, 2), 1 walls the start in and 1 the goal (0, 2).
    assert list(grid.supports.environment.names()) == [
        "blocked_r0c1_r1c1", "blocked_r1c0_r1c1", "blocked_r1c0_r1c2", "blocked_r1c1_r1c2",
    ]  # fmt: skip
    assert list(grid.supports.objective.names()) == ["goal_r2c2", "goal_r0c2"]
    first = grid.supports.environment[0]
    assert first.parameters == {"blocked": [[0, 1], [1, 1]]}
    assert np.flatnonzero(first.blocked).tolist() == [1, 4]
    assert grid.supports.environment[0] is first


@pytest.mark.parametrize(
    ("replacements", "shape"),
    [
        # 1 or 2 of 5 cells: 5 + 10.
        ([("choose: 2,", "choose: 2, distinct: false,"), ("\n    require_reachable: true", "")], (15, 2, 2)),
        # Unreachable ones dropped: (0, 2) alone, and the six pairs of the test above.
        ([("choose: 2,", "choose: 2, distinct: false,")], (8, 2, 2)),
        ([("require_reachable: true", "sample: 3")], (3, 2, 2)),
        ([("require_reachable: true", "require_reachable: true\n    sample: 4")], (4, 2, 2)),
    ],
)
def test_counts(tmp_path: Path, replacements: list[tuple[str, str]], shape: tuple[int, int, int]) -> None:
    case = load_grid(tmp_path, *replacements)
    assert case.shape == shape
    support = case.supports.environment
    for index, name in enumerate(support.names()):
        assert support.index(name) == index
        assert support.index_of(support.configurations.values(index)) == index


def test_a_sample_is_drawn_from_what_stays_reachable_and_depends_on_the_seed(tmp_path: Path) -> None:
    both = "require_reachable: true\n    sample: 2\n    seed: "
    drawn = {}
    for seed in range(8):
        case = load_grid(tmp_path, ("require_reachable: true", f"{both}{seed}"))
        drawn[seed] = set(case.supports.environment.names())
    everything = set(load_grid(tmp_path).supports.environment.names())
    assert all(len(names) == 2 and names < everything for names in drawn.values())
    assert len({frozenset(names) for names in drawn.values()}) > 1
    again = load_grid(tmp_path, ("require_reachable: true", f"{both}3"))
    assert set(again.supports.environment.names()) == drawn[3]


def test_a_sample_that_cannot_be_filled_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="only 4 of 10 configurations drawn leave every goal reachable"):
        load_grid(tmp_path, ("require_reachable: true", "require_reachable: true\n    sample: 5"))


def test_a_huge_support_is_counted_and_sampled_without_listing_it(tmp_path: Path) -> None:
    case = load_grid(
        tmp_path,
        ("rows: 3, cols: 3,", "rows: 30, cols: 30,"),
        (BLOCKED, "choose: 5, from: {rows: [1, 28], cols: [1, 28]}"),
        ("\n    require_reachable: true", ""),
    )
    assert case.supports.environment.count == math.comb(28 * 28, 5)
    assert case.size == math.comb(28 * 28, 5) * 4
    drawn = case.sample(50, np.random.default_rng(0))
    assert len({combination.name for combination in drawn}) == 50
    for combination in drawn:
        assert combination.environment.blocked.sum() == 5
        assert case.combination(combination.name).environment.parameters == combination.environment.parameters
    with pytest.raises(
        InputError, match=rf"has {case.size} combinations, too many to enumerate \(limit 10000\)"
    ):
        case.combinations()


def test_a_sample_of_a_huge_support(tmp_path: Path) -> None:
    case = load_grid(
        tmp_path,
        ("rows: 3, cols: 3,", "rows: 30, cols: 30,"),
        (BLOCKED, "choose: 5, from: {rows: [1, 28], cols: [1, 28]}"),
        ("require_reachable: true", "require_reachable: true\n    sample: 200"),
    )
    assert case.shape == (200, 2, 2)
    assert len(set(case.supports.environment.names())) == 200


@pytest.mark.parametrize(("total", "count"), [(10, 10), (1000, 3), (10**12, 20)])
def test_draws_are_distinct_and_in_range(total: int, count: int) -> None:
    ranks = np.concatenate(list(itertools.islice(draw(total, count, np.random.default_rng(1)), 5)))
    assert len(np.unique(ranks)) == len(ranks) >= count
    assert ranks.min() >= 0
    assert ranks.max() < total


def test_first_with_agrees_with_a_scan() -> None:
    product = Product((choice(4, range(2, 3)), choice(3, None, "goal")), "__")
    whole, part = Generated(product), Generated(product, np.array([4, 9, 13]))
    for support in (whole, part):
        listed = [support.values(index)["blocked"] for index in range(support.count)]
        for location in range(5):
            holding = [index for index, held in enumerate(listed) if location in held]  # type: ignore[operator]
            found = support.first_with("blocked", location)
            assert found in holding if holding else found is None
        assert support.locations("blocked") == {location for held in listed for location in held}  # type: ignore[union-attr]


def test_named_configurations(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, GRAPH))
    support = case.supports.capability
    assert list(support.names()) == ["slow", "fast"]
    assert support.index("fast") == 1
    assert support.index("quick") is None
    assert support.index_of(support.configurations.values(1)) == 1
    with pytest.raises(IndexError):
        support[2]


def test_a_small_memory_resolves_again(tmp_path: Path) -> None:
    support = load_declared_case(write_case(tmp_path, GRID)).supports.environment
    forgetful = type(support)(support.configurations, support.resolve, capacity=2)
    first = forgetful[0]
    assert [forgetful[index].name for index in (1, 2, 0)] == [support.name(index) for index in (1, 2, 0)]
    assert forgetful[0] is not first
    assert forgetful[0].parameters == first.parameters


NAMED_ENVIRONMENTS = """\
    open: {blocked: [], blocked_edges: [], lamp: 3}
    dim: {blocked: [B], blocked_edges: [[A, S]], lamp: 1}
"""
GENERATED_ENVIRONMENTS = """\
    generate:
      blocked: {choose: 1, from: [B]}
      blocked_edges: {choose: 1, from: [[S, A], [A, S]]}
      lamp: {from: [3, 1]}
"""
NAMED_CAPABILITIES = """\
    slow: {grip: 0.9, has_scanner: true, strong: true}
    fast: {grip: 0.8, has_scanner: false, strong: false}
"""
GENERATED_CAPABILITIES = """\
    generate: {grip: {from: [0.9, 0.05]}, has_scanner: {from: [true]}, strong: {from: [true, false]}}
"""


def test_generated_edges_and_numbers(tmp_path: Path) -> None:
    text = GRAPH[: GRAPH.index("online:")]
    text = replaced(text, NAMED_ENVIRONMENTS, GENERATED_ENVIRONMENTS)
    text = replaced(text, NAMED_CAPABILITIES, GENERATED_CAPABILITIES)
    case = load_declared_case(write_case(tmp_path, text))
    assert list(case.supports.environment.names()) == [
        "blocked_B___blocked_edges_S_east___lamp_3",
        "blocked_B___blocked_edges_S_east___lamp_1",
        "blocked_B___blocked_edges_A_west___lamp_3",
        "blocked_B___blocked_edges_A_west___lamp_1",
    ]
    assert case.supports.environment[2].parameters == {
        "blocked": ["B"],
        "blocked_edges": [["A", "S", "west"]],
        "lamp": 3,
    }
    assert list(case.supports.capability.names())[2] == "grip_0p05__has_scanner_true__strong_true"
    for index, name in enumerate(case.supports.capability.names()):
        assert case.supports.capability.index(name) == index


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000))
def test_reachability_agrees_with_networkx(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Second route: one networkx search for each environment."""
    space = load_declared_case(write_case(tmp_path_factory.mktemp("reach"), GRID)).space
    generator = np.random.default_rng(seed)
    closed = generator.random((6, space.num_locations)) < 0.4
    closed_edges = generator.random((6, *space.target.shape)) < 0.3
    starts, goals = np.array([0, 4]), np.array([8, 2])
    expected = []
    for environment in range(6):
        moves = passable(space, closed[environment], closed_edges[environment])
        graph: nx.DiGraph[int] = nx.DiGraph()
        graph.add_nodes_from(range(space.num_locations))
        graph.add_edges_from((int(p), int(space.target[p, label])) for p, label in np.argwhere(moves))
        found = nx.descendants(graph, 0) | {0}
        mask = reachable(space, 0, closed, closed_edges)[environment]
        assert set(np.flatnonzero(mask).tolist()) == found
        expected.append(
            not closed[environment, starts].any()
            and all(nx.has_path(graph, start, goal) for start in starts for goal in goals)
        )
    assert leaves_goals_reachable(space, starts, goals, closed, closed_edges).tolist() == expected
