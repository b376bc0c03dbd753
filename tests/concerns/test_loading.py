"""From a file to a case study: the examples and the shipped case studies."""

from __future__ import annotations

import hashlib
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from merap.checker.obstruction import goal_locations
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.errors import InputError
from tests.support.case_examples import GRAPH, GRID, replaced, write_case
from tests.support.paths import MODELS


def map_of(combination: DeclaredCombination) -> nx.DiGraph[str]:
    """The locations and the moves that are possible between them."""
    space = combination.space
    graph: nx.DiGraph[str] = nx.DiGraph()
    graph.add_nodes_from(space.locations)
    for location, label in np.argwhere(combination.passable):
        graph.add_edge(space.locations[location], space.locations[space.target[location, label]])
    return graph


def ends(combination: DeclaredCombination) -> tuple[str, str]:
    """The one start and the one goal."""
    locations = combination.space.locations
    (start,) = np.flatnonzero(combination.objective.start)
    (goal,) = np.flatnonzero(goal_locations(combination))
    return locations[start], locations[goal]


@pytest.fixture
def grid(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, GRID))


@pytest.fixture
def graph(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, GRAPH))


def test_a_folder_stands_for_its_case_file(tmp_path: Path) -> None:
    path = write_case(tmp_path, GRID)
    case = load_declared_case(tmp_path)
    assert case.source == path
    assert case.name == "small_grid"
    assert case.digest == hashlib.sha256(GRID.encode()).hexdigest()


def test_a_space_file_is_part_of_the_digest(tmp_path: Path) -> None:
    space = GRAPH[GRAPH.index("  locations:") : GRAPH.index("environment:")]
    inside = load_declared_case(write_case(tmp_path, GRAPH))
    text = replaced(GRAPH, f"space:\n{space}", "space: {file: floor.yaml}\n")
    outline = "".join(line[2:] for line in space.splitlines(keepends=True))
    write_case(tmp_path, outline, "floor.yaml")
    case = load_declared_case(write_case(tmp_path, text))
    assert case.digest == hashlib.sha256(text.encode() + outline.encode()).hexdigest()
    assert case.space.locations == inside.space.locations
    np.testing.assert_array_equal(case.space.target, inside.space.target)


def test_combinations_run_over_objectives_fastest(grid: DeclaredCase) -> None:
    names = [combination.name for combination in grid.combinations()]
    assert len(names) == grid.size == 16
    assert names[:3] == [
        "blocked_r0c1_r1c1.no_entry_r2c0.goal_r2c2",
        "blocked_r0c1_r1c1.no_entry_r2c0.goal_r0c2",
        "blocked_r0c1_r1c1.no_entry_r2c1.goal_r2c2",
    ]
    assert [grid.combination_at(index).name for index in range(16)] == names
    assert [grid.combination(name).name for name in names] == names


def test_too_many_combinations_name_count_and_limit(grid: DeclaredCase) -> None:
    with pytest.raises(InputError, match=r"small_grid has 16 combinations, too many .*\(limit 15\)"):
        grid.combinations(limit=15)


def test_a_sample_has_distinct_combinations_and_depends_on_the_generator(grid: DeclaredCase) -> None:
    first = [combination.name for combination in grid.sample(5, np.random.default_rng(1))]
    again = [combination.name for combination in grid.sample(5, np.random.default_rng(1))]
    other = [combination.name for combination in grid.sample(5, np.random.default_rng(2))]
    assert first == again != other
    assert len(set(first)) == 5
    assert len({combination.name for combination in grid.sample(100, np.random.default_rng(0))}) == 16


def test_a_sample_is_uniform(grid: DeclaredCase) -> None:
    """Counts of 16 equally likely combinations over 1,600 draws of one: chi-square, 15 degrees."""
    generator = np.random.default_rng(7)
    names = [grid.sample(1, generator)[0].name for _ in range(1600)]
    _, counts = np.unique(names, return_counts=True)
    assert len(counts) == 16
    assert ((counts - 100.0) ** 2 / 100).sum() < 37.7  # exceeded with probability 0.001


def test_shared_configurations_are_resolved_once(grid: DeclaredCase) -> None:
    first, second = grid.combination_at(0), grid.combination_at(1)
    assert first.environment is second.environment
    assert first.capability is second.capability
    assert first.objective is not second.objective


def test_online_systems(grid: DeclaredCase) -> None:
    met, covered = grid.system("met"), grid.system("covered")
    assert list(grid.systems) == ["met", "covered"]
    assert (met.environment.name, met.capability.name, met.objective.name) == (
        "met",
        "no_entry_r2c0",
        "goal_r2c2",
    )
    assert not grid.covered(met)
    assert covered.environment.name == "blocked_r0c1_r1c1"
    assert grid.covered(covered)
    name = "blocked_r1c0_r1c2.no_entry_r2c1.goal_r0c2"
    assert grid.system(name).name == name
    assert grid.covered(grid.system(name))


@pytest.mark.parametrize(("old", "new"), [("horizon: 6}", "horizon: 7}"), ("horizon: 6}", "start: [1, 2]}")])
def test_another_start_or_horizon_is_not_covered(tmp_path: Path, old: str, new: str) -> None:
    case = load_declared_case(write_case(tmp_path, replaced(GRID, old, new)))
    assert not case.covered(case.system("covered"))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mett", "has no system 'mett'; did you mean 'met'"),
        ("a.b", "has no system 'a.b'"),
        (
            "blocked_r0c1_r1c1.no_entry_r2c0.goal_r2c1",
            "did you mean 'blocked_r0c1_r1c1.no_entry_r2c0.goal_r2c2'",
        ),
    ],
)
def test_an_unknown_system_names_what_is_near(grid: DeclaredCase, name: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        grid.system(name)
    assert message in caught.value.message


def test_an_unknown_combination_names_what_is_near(grid: DeclaredCase) -> None:
    with pytest.raises(
        InputError, match=r"has no combination 'blocked_r0c1_r1c1\.no_entry_r2c0'; did you mean"
    ):
        grid.combination("blocked_r0c1_r1c1.no_entry_r2c0")


def test_modes_and_actions_are_numbered_once(grid: DeclaredCase, graph: DeclaredCase) -> None:
    assert grid.modes == ("ready",)
    assert grid.actions == ("stop", "up", "down", "left", "right")
    assert graph.modes == ("idle", "scanning", "scanned")
    assert graph.actions == ("stop", "east", "north", "south", "west", "measure", "start_scan")


def test_a_rule_about_what_a_capability_lacks_warns(graph: DeclaredCase) -> None:
    assert graph.warnings == (
        "objective.rewards[0]: names 'scanned', which capability fast lacks: it never matches there",
        "objective.rewards[2]: names 'west', which capability fast lacks: it never matches there",
        "objective.ends_in: names 'scanned', which capability fast lacks: it never matches there",
    )


def test_a_parameter_that_nothing_reads_warns(tmp_path: Path) -> None:
    text = replaced(GRAPH, "{light: {A: lamp}}", "{}")
    text = replaced(text, "value: 10 + bonus", "value: 10")
    warnings = load_declared_case(write_case(tmp_path, text)).warnings
    assert warnings[:2] == (
        "environment.parameters.lamp: nothing reads this parameter",
        "objective.parameters.bonus: nothing reads this parameter",
    )


# Sizes and optima: the table of the experiments in the paper's section V; a shortest path of d
# moves earns 10 - 0.5 d.
PAPER = [
    (1, (1, 1, 16), True, 6.0),
    (2, (10_324, 1, 1), True, 6.0),
    (3, (1, 3, 1), True, 6.0),
    (4, (1001, 3, 9), True, 6.0),
    (5, (1, 1, 16), False, 8.0),
    (6, (495, 1, 1), False, 5.0),
    (7, (1, 3, 1), False, 6.0),
    (8, (495, 3, 9), False, 8.0),
]


@pytest.mark.parametrize(("number", "shape", "covered", "optimum"), PAPER)
def test_the_paper_grid(number: int, shape: tuple[int, int, int], covered: bool, optimum: float) -> None:
    case = load_declared_case(MODELS / "paper-grid" / f"rq1-{number}.yaml")
    assert case.name == f"paper_rq1_{number}"
    assert case.shape == shape
    assert case.actions == ("stop", "up", "down", "left", "right")
    assert case.warnings == ()
    met = case.system("met")
    assert case.covered(met) == covered
    assert met.objective.horizon == 18
    start, goal = ends(met)
    assert start == "r0c0"
    assert 10 - 0.5 * nx.shortest_path_length(map_of(met), start, goal) == optimum
    for combination in case.sample(20, np.random.default_rng(number)):
        assert nx.has_path(map_of(combination), *ends(combination))


def test_the_obstacles_that_wall_the_start_in_are_dropped() -> None:
    """Of the 10,626 = C(24, 4) environments of RQ1-2, 302 wall the start in (the paper's log)."""
    support = load_declared_case(MODELS / "paper-grid" / "rq1-2.yaml").supports.environment
    product = support.configurations.product  # type: ignore[attr-defined]
    assert (product.count, product.count - support.count) == (10_626, 302)


def test_the_running_example() -> None:
    """Table I of the paper, and what its text says of the online system."""
    case = load_declared_case(MODELS / "running-example")
    assert case.shape == (3, 2, 3)
    assert list(case.supports.environment.names()) == ["b_blocked", "c_blocked", "bc_blocked"]
    assert list(case.supports.capability.names()) == ["speed_low", "speed_high"]
    assert list(case.supports.objective.names()) == ["g1", "g2", "g3"]
    assert case.space.num_locations >= 20
    assert case.warnings == ()
    met = case.system("met")
    assert not case.covered(met)
    assert ends(met) == ("S", "G3")
    blocked = [case.space.locations[index] for index in np.flatnonzero(met.environment.blocked)]
    assert blocked == ["A"]


def test_the_running_example_forces_another_way() -> None:
    """Every shortest way to G3 in the models leads through A; with A blocked all lead through B or C."""
    case = load_declared_case(MODELS / "running-example")
    for combination in case.combinations():
        if combination.objective.name == "g3":
            ways = list(nx.all_shortest_paths(map_of(combination), "S", "G3"))
            assert all("A" in way for way in ways)
    open_map = map_of(case.system("met"))
    assert {next(iter({"B", "C"} & set(way))) for way in nx.all_shortest_paths(open_map, "S", "G3")} == {
        "B",
        "C",
    }
    open_map.remove_nodes_from(["B", "C"])
    assert not nx.has_path(open_map, "S", "G3")


def test_the_floor_can_be_driven_both_ways_and_drawn() -> None:
    space = load_declared_case(MODELS / "running-example").space
    back = {"north": "south", "south": "north", "east": "west", "west": "east"}
    step = {"north": (0, 4), "south": (0, -4), "east": (4, 0), "west": (-4, 0)}
    for location, label in np.argwhere(space.target >= 0):
        target = space.target[location, label]
        assert space.target[target, space.moves.index(back[space.moves[label]])] == location
        shift = space.positions[target] - space.positions[location]
        assert tuple(shift) == step[space.moves[label]]
    assert len({tuple(position) for position in space.positions}) == space.num_locations
