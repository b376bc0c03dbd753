"""Maps: a combination as a picture, with a policy and paths on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from merap.concerns.combination import Combination
from merap.mdp.model import Floats
from merap.report.colouring import Colouring, colour_by
from merap.report.edges import draw_edges
from merap.report.frame import Frame, frame_of
from merap.report.geometry import EdgeLines, edge_lines
from merap.report.locations import draw_locations, draw_names
from merap.report.moves import draw_policy
from merap.report.path import RoutePath
from merap.report.routes import draw_routes
from merap.report.sheet import close_sheet, open_sheet
from merap.report.style import LINES, Entry, Line


def draw_map(
    combination: Combination,
    *,
    attribute: str | None = None,
    policy: Floats | None = None,
    paths: Sequence[RoutePath] = (),
    title: str | None = None,
) -> Figure:
    """Draw the space of a combination and what its three concerns say about it.

    Args:
        combination: what to draw.
        attribute: colours the locations; None takes the first that is not the same everywhere.
        policy: float [S, A] on the canonical index, drawn as arrows; None draws none.
        paths: drawn as lines, next to each other.
        title: None takes the combination's name.

    Raises:
        InputError: there is no such attribute.
        ModelError: the policy has another shape.
    """
    colouring = colour_by(combination, attribute)
    frame, lines = _frame_and_lines(combination)
    sheet = open_sheet(frame, panels=1)
    entries = _draw_base(sheet.panels[0], frame, lines, combination, colouring)
    if policy is not None:
        entries += draw_policy(sheet.panels[0], frame, lines, combination, policy)
    if paths:
        entries += draw_routes(
            sheet.panels[0], frame, lines, combination, list(zip(paths, _styles(len(paths)), strict=True))
        )
    return close_sheet(sheet, title=title or combination.name, entries=entries, colour_bar=_bar(colouring))


def draw_before_after(
    combination: Combination,
    before: RoutePath,
    after: RoutePath,
    *,
    attribute: str | None = None,
    title: str | None = None,
) -> Figure:
    """Two maps of the same combination: the path before adaptation and the one after it.

    Args:
        combination: what was really there.
        before: path of the policy before adaptation.
        after: path of the adapted policy.
        attribute: as for `draw_map`.
        title: None takes the combination's name.

    Raises:
        InputError: there is no such attribute.
    """
    colouring = colour_by(combination, attribute)
    frame, lines = _frame_and_lines(combination)
    sheet = open_sheet(frame, panels=2)
    named = (replace(before, label="before"), replace(after, label="after"))
    entries: list[Entry] = []
    for panel, path, style in zip(sheet.panels, named, _styles(2), strict=True):
        entries += _draw_base(panel, frame, lines, combination, colouring)
        entries += draw_routes(panel, frame, lines, combination, [(path, style)])
    return close_sheet(
        sheet,
        title=title or combination.name,
        panel_titles=("Before adaptation", "After adaptation"),
        entries=entries,
        colour_bar=_bar(colouring),
    )


def _frame_and_lines(combination: Combination) -> tuple[Frame, EdgeLines]:
    frame = frame_of(combination.space)
    clearance = 0.0 if frame.is_grid else 1.3 * frame.radius
    return frame, edge_lines(combination.space, combination.environment.blocked_edges, clearance)


def _draw_base(
    panel: Axes, frame: Frame, lines: EdgeLines, combination: Combination, colouring: Colouring
) -> list[Entry]:
    edges = draw_edges(panel, frame, lines)
    locations = draw_locations(panel, frame, combination, colouring)
    draw_names(panel, frame, combination.space, lines)
    return [*locations, *edges, *colouring.entries]


def _bar(colouring: Colouring) -> tuple[ScalarMappable, str] | None:
    return None if colouring.scale is None else (colouring.scale, colouring.title)


def _styles(count: int) -> list[Line]:
    """One per path; the last is the solid one."""
    return [LINES[(count - 1 - index) % len(LINES)] for index in range(count)]
