"""Maps: what is drawn and where, and that names can be read."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from merap.concerns.case_study import load_case
from merap.concerns.combination import Combination
from merap.concerns.space import Attribute
from merap.concerns.synthesis import synthesise
from merap.errors import InputError, ModelError
from merap.families.build import canonical
from merap.families.models import explored
from merap.mdp.evaluation import as_policy
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import value_iteration
from merap.report.labels import place_labels
from merap.report.locations import label_locations
from merap.report.map import draw_before_after, draw_map
from merap.report.path import RoutePath, most_likely_path
from tests.support.hand_made import cells, graph_combination, grid_combination, with_environment
from tests.support.paths import ROOT
from tests.support.route_paths import written_path


@pytest.fixture(scope="module")
def building() -> Combination:
    """26 named locations; A is blocked."""
    return load_case(ROOT / "models" / "running-example").system("met")


@pytest.fixture(scope="module")
def adapted(building: Combination) -> RoutePath:
    mdp = canonical(building, synthesise(building))
    policy = as_policy(mdp, value_iteration(mdp, building.discount).actions)
    return most_likely_path(mdp, building, policy, 40)


def named(axes: Axes, name: str) -> list[Any]:
    """The artists drawn under that name, which are of many kinds."""
    return [artist for artist in axes.get_children() if artist.get_gid() == name]


def rows_of(mdp: TabularMDP, **chances: float) -> Floats:
    """The same choice in every state."""
    policy = np.zeros((mdp.num_states, mdp.num_actions))
    for name, chance in chances.items():
        policy[:, mdp.action_names.index(name)] = chance
    return policy


def only(axes: Axes, name: str) -> Any:
    (artist,) = named(axes, name)
    return artist


def polygons(axes: Axes, name: str) -> list[Floats]:
    return [path.vertices[:-1] for path in only(axes, name).get_paths()]


def points(axes: Axes, name: str) -> Floats:
    """Where a mark stands, float64 [M, 2]: the places of its uppermost layer."""
    places: Floats = named(axes, name)[-1].get_xydata()
    return places


def legend_of(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text().strip() for text in legend.get_texts()]


def position(combination: Combination, *names: str) -> Floats:
    return combination.space.positions[[combination.space.location_index[name] for name in names]]


def test_every_location_is_a_circle_at_its_position(building: Combination) -> None:
    axes = draw_map(building).axes[0]
    paths = [path for part in named(axes, "locations") for path in part.get_paths()]
    centres = np.array([path.get_extents().get_points().mean(axis=0) for path in paths])
    assert len(centres) == 26
    np.testing.assert_allclose(centres, building.space.positions, atol=1e-9)


def test_every_pair_of_neighbours_is_one_line(building: Combination) -> None:
    segments = only(draw_map(building).axes[0], "edges").get_segments()
    source, label = np.nonzero(building.space.target >= 0)
    expected = {frozenset(pair) for pair in zip(source, building.space.target[source, label], strict=True)}
    where = {tuple(place): index for index, place in enumerate(building.space.positions)}
    assert {frozenset(where[tuple(end)] for end in segment) for segment in segments} == expected
    assert len(segments) == len(expected) == 29  # counted in the case file


def test_names_are_there_and_overlap_nothing(building: Combination) -> None:
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


def test_the_three_concerns_are_marked_and_explained(building: Combination) -> None:
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


def test_unsafe_locations_are_those_of_the_synthesised_model() -> None:
    combination = graph_combination()
    whole = synthesise(combination)
    location = whole.valuations[:, whole.variable_names.index("loc")]
    # `light = 0` holds at B alone.
    assert np.flatnonzero(label_locations(combination, explored(combination), "unsafe")).tolist() == [2]
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


def test_the_attribute_that_varies_gives_the_colours(building: Combination) -> None:
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


def test_an_unknown_attribute_is_refused(building: Combination) -> None:
    with pytest.raises(InputError, match="unknown attribute 'heat'; allowed: light, slippery"):
        draw_map(building, attribute="heat")


def test_a_policy_is_an_arrow_per_location() -> None:
    combination = grid_combination(size=3, goal=(2, 2), blocked=cells((1, 1), size=3))
    mdp = explored(combination)
    policy = rows_of(mdp, right=0.8, up=0.2)
    policy[(mdp.valuations[:, :2] == 2).all(axis=1)] = rows_of(mdp, stop=0.6, up=0.4)[0]
    figure = draw_map(combination, policy=policy)
    shapes = polygons(figure.axes[0], "policy")
    *moving, staying = shapes
    assert len(moving) == 7  # 9 cells without the blocked one and the goal
    tips = np.array([shape[3] for shape in moving])
    tails = np.array([(shape[0] + shape[6]) / 2 for shape in moving])
    assert (tips[:, 0] > tails[:, 0]).all()
    np.testing.assert_allclose(tips[:, 1], tails[:, 1], atol=1e-12)
    np.testing.assert_allclose(staying.mean(axis=0), [2, -2])
    assert {"moves", "stays"} <= set(legend_of(figure))


def test_less_likely_moves_are_thinner_and_paler() -> None:
    combination = grid_combination(size=3, goal=(2, 2))
    mdp = explored(combination)
    policy = rows_of(mdp, right=1.0) * np.linspace(0.2, 1.0, mdp.num_states)[:, None]
    axes = draw_map(combination, policy=policy).axes[0]
    widths = [np.linalg.norm(shape[0] - shape[6]) for shape in polygons(axes, "policy")]
    greys = only(axes, "policy").get_facecolor()[:, 0]
    assert (np.diff(widths) > 0).all()
    assert (np.diff(greys) < 0).all()


def test_each_mode_that_can_move_has_its_own_arrows(building: Combination) -> None:
    mdp = explored(building)
    policy = rows_of(mdp, start_scan=1)
    policy[mdp.valuations[:, mdp.variable_names.index("mode")] == 2] = rows_of(mdp, east=1)[0]
    figure = draw_map(building, policy=policy)
    texts = legend_of(figure)
    # The initial mode comes first.
    assert texts[-2:] == ["innate action in mode idle", "moves in mode scanned"]
    assert "moves in mode idle" not in texts
    idle, scanned = named(figure.axes[0], "policy")
    assert (len(idle.get_paths()), len(scanned.get_paths())) == (25, 25)


def test_a_policy_of_another_shape_is_refused(building: Combination) -> None:
    with pytest.raises(ModelError, match=r"shape \(5, 5\), not \(\d+, 8\)"):
        draw_map(building, policy=np.ones((5, 5)))


def test_a_path_runs_through_its_locations(building: Combination, adapted: RoutePath) -> None:
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


def test_before_and_after_are_two_maps_of_one_scale(building: Combination, adapted: RoutePath) -> None:
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


def test_the_legend_lies_beside_the_map(building: Combination, adapted: RoutePath) -> None:
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
