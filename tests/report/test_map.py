"""Maps: what is drawn and where, and that names can be read."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from merap.concerns.combination import DeclaredCombination
from merap.concerns.lookup import declared
from merap.concerns.space import Attribute
from merap.errors import InputError
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.evaluation import as_policy
from merap.mdp.model import Floats
from merap.mdp.planning import value_iteration
from merap.report.labels import place_labels
from merap.report.locations import label_locations
from merap.report.map import draw_before_after, draw_map
from merap.report.path import RoutePath, most_likely_path
from tests.support.drawings import legend_of, named, only, points, polygons
from tests.support.hand_made import cells, graph_combination, grid_combination, with_environment
from tests.support.paths import ROOT
from tests.support.route_paths import written_path


@pytest.fixture(scope="module")
def building() -> DeclaredCombination:
    """26 named locations; A is blocked."""
    return declared(load_case(ROOT / "models" / "running-example").system("met"))


@pytest.fixture(scope="module")
def adapted(building: DeclaredCombination) -> RoutePath:
    mdp = explored(building)
    policy = as_policy(mdp, value_iteration(mdp, building.discount).actions)
    return most_likely_path(mdp, building, policy, 40)


def position(combination: DeclaredCombination, *names: str) -> Floats:
    return combination.space.positions[[combination.space.location_index[name] for name in names]]


def test_every_location_is_a_circle_at_its_position(building: DeclaredCombination) -> None:
    axes = draw_map(building).axes[0]
    paths = [path for part in named(axes, "locations") for path in part.get_paths()]
    centres = np.array([path.get_extents().get_points().mean(axis=0) for path in paths])
    assert len(centres) == 26
    np.testing.assert_allclose(centres, building.space.positions, atol=1e-9)


def test_every_pair_of_neighbours_is_one_line(building: DeclaredCombination) -> None:
    segments = only(draw_map(building).axes[0], "edges").get_segments()
    source, label = np.nonzero(building.space.target >= 0)
    expected = {frozenset(pair) for pair in zip(source, building.space.target[source, label], strict=True)}
    where = {tuple(place): index for index, place in enumerate(building.space.positions)}
    assert {frozenset(where[tuple(end)] for end in segment) for segment in segments} == expected
    assert len(segments) == len(expected) == 29  # counted in the case file


def test_names_are_there_and_overlap_nothing(building: DeclaredCombination) -> None:
    figure = draw_map(building)
    axes = figure.axes[0]
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    boxes = {text.get_text(): text.get_window_extent(renderer) for text in axes.texts}
    assert sorted(boxes) == sorted(building.space.locations)
    assert not [(a, b) for a, b in combinations(boxes, 2) if boxes[a].overlaps(boxes[b])]
    circles = [
        path.get_extents(axes.transData) for part in named(axes, "locations") for path in part.get_paths()
    ]
    assert not [name for name, box in boxes.items() if box.count_overlaps(circles)]
    page = axes.get_window_extent(renderer)
    assert all(page.contains(*box.min) and page.contains(*box.max) for box in boxes.values())
    assert min(float(text.get_fontsize()) for text in axes.texts) >= 8


def test_names_of_close_locations_make_way_for_each_other() -> None:
    anchors, sizes = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]), np.array([[0.9, 0.2]] * 3)
    page = (np.array([-2.0, -2.0]), np.array([3.0, 2.0]))
    places = place_labels(anchors, np.full(3, 0.1), sizes, np.zeros((0, 2)), page)
    apart = [np.any(np.abs(a - b) >= sizes[0]) for a, b in combinations(places, 2)]
    assert all(apart)


def test_the_three_concerns_are_marked_and_explained(building: DeclaredCombination) -> None:
    capability = replace(building.capability, no_entry=np.isin(building.space.locations, ["lift", "stairs"]))
    figure = draw_map(replace(building, capability=capability))
    axes = figure.axes[0]
    np.testing.assert_array_equal(points(axes, "blocked (environment)"), position(building, "A"))
    np.testing.assert_array_equal(points(axes, "no entry (capability)"), position(building, "lift", "stairs"))
    np.testing.assert_array_equal(points(axes, "start"), position(building, "S"))
    np.testing.assert_array_equal(points(axes, "goal"), position(building, "G3"))
    assert len(points(axes, "unsafe")) == 2
    meanings = {"start", "goal", "blocked (environment)", "no entry (capability)", "unsafe"}
    assert meanings <= set(legend_of(figure))
    # Not by colour alone.
    assert len({named(axes, meaning)[-1].get_marker() for meaning in meanings}) == 5


def test_blocked_cells_of_a_grid_are_marked_in_their_cells() -> None:
    combination = grid_combination(blocked=cells((1, 2), (6, 1)), no_entry=cells((4, 3)))
    axes = draw_map(combination).axes[0]
    # x is the column, y is the row, counted downwards.
    assert points(axes, "blocked (environment)").tolist() == [[2, -1], [1, -6]]
    assert points(axes, "no entry (capability)").tolist() == [[3, -4]]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [str(row) for row in range(9)]
    assert axes.get_yticks().tolist() == [-row for row in range(9)]


def test_unsafe_locations_are_those_of_the_model() -> None:
    combination = graph_combination()
    whole = explored(combination)
    location = whole.valuations[:, whole.variable_names.index("loc")]
    # `light = 0` holds at B alone.
    assert np.flatnonzero(label_locations(combination, whole, "unsafe")).tolist() == [2]
    assert set(location[whole.labels["unsafe"]]) == {2}


def test_a_goal_that_is_out_of_reach_is_drawn() -> None:
    walls = cells((1, 2), (2, 1), size=3)
    combination = grid_combination(size=3, goal=(2, 2), blocked=walls)
    axes = draw_map(combination).axes[0]
    assert points(axes, "goal").tolist() == [[2, -2]]


def test_a_blocked_edge_has_a_bar_across_its_middle() -> None:
    combination = grid_combination(size=3, goal=(2, 2))
    blocked = np.zeros_like(combination.space.target, dtype=np.bool_)
    blocked[0, combination.space.moves.index("right")] = True
    figure = draw_map(with_environment(combination, blocked_edges=blocked))
    (bar,) = only(figure.axes[0], "blocked edges").get_segments()
    # The wall between the cells (0, 0) and (0, 1).
    np.testing.assert_allclose(sorted(bar.tolist()), [[0.5, -0.5], [0.5, 0.5]])
    assert "blocked edge" in legend_of(figure)


def test_an_edge_of_one_direction_has_an_arrow_head() -> None:
    # Only `across`, 0 -> 2, has no way back; it passes location 1, so it is bent.
    axes = draw_map(graph_combination()).axes[0]
    (head,) = polygons(axes, "one-way edges")
    assert (head[0] - head[1:].mean(axis=0)) @ np.array([1, 1]) > 0
    sizes = sorted(len(line) for line in only(axes, "edges").get_segments())
    assert sizes == [2, 2, 2, 25]


def test_the_attribute_that_varies_gives_the_colours(building: DeclaredCombination) -> None:
    by_default = legend_of(draw_map(building))
    assert {"light = 0", "light = 1", "light = 2", "light = 3"} <= set(by_default)
    slippery = draw_map(building, attribute="slippery")
    assert {"slippery = yes", "slippery = no"} <= set(legend_of(slippery))
    plain, dotted = named(slippery.axes[0], "locations")
    assert (len(plain.get_paths()), len(dotted.get_paths())) == (23, 3)
    assert dotted.get_hatch() is not None


def test_a_real_attribute_has_a_colour_bar() -> None:
    combination = grid_combination(size=3, goal=(2, 2))
    height = Attribute("height", "real", 0.0, 2.0, np.linspace(0, 1.5, 9))
    figure = draw_map(with_environment(combination, attributes=(height,)))
    _, bar = figure.axes
    assert bar.get_title(loc="left") == "height"
    assert bar.get_ylim() == (0.0, 2.0)


def test_an_unknown_attribute_is_refused(building: DeclaredCombination) -> None:
    with pytest.raises(InputError, match="unknown attribute 'heat'; allowed: light, slippery"):
        draw_map(building, attribute="heat")


def test_a_path_runs_through_its_locations(building: DeclaredCombination, adapted: RoutePath) -> None:
    figure = draw_map(building, paths=[adapted])
    (line,) = named(figure.axes[0], "path")
    drawn = np.unique(line.get_xydata(), axis=0)
    visited = np.unique(position(building, *adapted.places), axis=0)
    np.testing.assert_allclose(drawn, visited)
    assert "path: completed in 10 steps" in legend_of(figure)
    assert "innate: measure, start_scan" in legend_of(figure)


def test_paths_on_the_same_edges_lie_side_by_side() -> None:
    combination = grid_combination(size=3, goal=(0, 2))
    there = written_path(
        combination, [(0, "right"), (1, "right"), (2, "stop")], 2, "completed", label="there"
    )
    back = written_path(combination, [(2, "left"), (1, "left")], 0, label="back")
    axes = draw_map(combination, paths=[there, replace(there, label="again"), back]).axes[0]
    heights = [named(axes, name)[0].get_ydata() for name in ("there", "again", "back")]
    assert all(np.ptp(height) < 1e-12 for height in heights)
    levels = sorted(float(height[0]) for height in heights)
    assert min(np.diff(levels)) > 0.1
    # Traffic keeps to the right: eastwards below the middle, westwards above.
    assert levels[0] < levels[1] < 0 < levels[2]
    styles = {str(named(axes, name)[0]._dash_pattern) for name in ("there", "again", "back")}
    assert len(styles) == 3


def test_before_and_after_are_two_maps_of_one_scale(
    building: DeclaredCombination, adapted: RoutePath
) -> None:
    index = building.space.location_index
    stuck = written_path(building, [(index["S"], "east"), (index["lobby"], "east")], index["lobby"])
    figure = draw_before_after(building, stuck, adapted)
    left, right = figure.axes
    assert left.get_xlim() == right.get_xlim()
    assert len(named(left, "before")) == len(named(right, "after")) == 1
    assert not named(left, "after")
    assert not left.get_window_extent().overlaps(right.get_window_extent())
    texts = legend_of(figure)
    assert {"before: not completed in 2 steps", "after: completed in 10 steps"} <= set(texts)
    assert len(texts) == len(set(texts))


def test_the_legend_lies_beside_the_map(building: DeclaredCombination, adapted: RoutePath) -> None:
    figure = draw_map(building, paths=[adapted])
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    box = figure.legends[0].get_window_extent(renderer)
    assert box.x0 > figure.axes[0].get_window_extent(renderer).x1
    assert figure.bbox.x1 > box.x1
    assert box.y0 > 0


@pytest.mark.parametrize("size", [1, 20])
def test_grids_of_any_size_have_square_cells_on_a_page(size: int) -> None:
    combination = grid_combination(size=size, goal=(size - 1, size - 1))
    mdp = explored(combination)
    policy = np.full((mdp.num_states, mdp.num_actions), 0.2)
    figure = draw_map(combination, policy=policy)
    box = figure.axes[0].get_window_extent()
    assert box.width == pytest.approx(box.height)
    assert max(figure.get_size_inches()) < 13
