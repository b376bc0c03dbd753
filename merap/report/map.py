"""Maps: a combination as a picture, with a policy and paths on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from merap.concerns.combination import DeclaredCombination
from merap.mdp.model import Floats
from merap.report.colouring import Colouring, colour_by
from merap.report.edges import draw_edges
from merap.report.locations import draw_locations, draw_names
from merap.report.moves import draw_policy
from merap.report.path import RoutePath
from merap.report.routes import draw_routes
from merap.report.sheet import Panel, close_sheet, open_sheet
from merap.report.style import LINES, Entry, Line


def draw_map(
    combination: DeclaredCombination,
    *,
    attribute: str | None = None,
    policy: Floats | None = None,
    paths: Sequence[RoutePath] = (),
    title: str | None = None,
) -> Figure:
    """Draw the space of a combination and what its three concerns say about it.

    Args:
        combination: the one to draw.
        attribute: colours the locations; None takes the first that is not the same everywhere.
        policy: float [S, A] on the canonical index, drawn as arrows; None draws none.
        paths: drawn as lines, next to each other.
        title: None takes the combination's name.

    Raises:
        InputError: there is no such attribute.
        ModelError: the policy has another shape.
    """
    colouring = colour_by(combination, attribute)
    sheet = open_sheet(combination, panels=1)
    entries = _draw_base(sheet.panels[0], colouring)
    if policy is not None:
        entries += draw_policy(sheet.panels[0], policy)
    if paths:
        entries += draw_routes(
            sheet.panels[0],
            list(zip(paths, _styles(len(paths)), strict=True)),
            beside=policy is not None,
        )
    return close_sheet(sheet, title=title or combination.name, entries=entries, colour_bar=_bar(colouring))


def draw_before_after(
    combination: DeclaredCombination,
    before: RoutePath,
    after: RoutePath,
    *,
    attribute: str | None = None,
    title: str | None = None,
) -> Figure:
    """Draw two maps of the same combination: the path before adaptation and the one after it.

    Args:
        combination: the true one.
        before: path of the policy before adaptation.
        after: path of the adapted policy.
        attribute: as for `draw_map`.
        title: None takes the combination's name.

    Raises:
        InputError: there is no such attribute.
    """
    colouring = colour_by(combination, attribute)
    sheet = open_sheet(combination, panels=2)
    named = (replace(before, label="before"), replace(after, label="after"))
    entries: list[Entry] = []
    for panel, path, style in zip(sheet.panels, named, _styles(2), strict=True):
        entries += [*_draw_base(panel, colouring), *draw_routes(panel, [(path, style)])]
    return close_sheet(
        sheet,
        title=title or combination.name,
        panel_titles=("Before adaptation", "After adaptation"),
        entries=entries,
        colour_bar=_bar(colouring),
    )


def _draw_base(panel: Panel, colouring: Colouring) -> list[Entry]:
    edges = draw_edges(panel)
    locations = draw_locations(panel, colouring)
    draw_names(panel)
    return [*locations, *edges, *colouring.entries]


def _bar(colouring: Colouring) -> tuple[ScalarMappable, str] | None:
    return None if colouring.scale is None else (colouring.scale, colouring.title)


def _styles(count: int) -> list[Line]:
    """Return a style for each path; the last is the solid one."""
    return [LINES[(count - 1 - index) % len(LINES)] for index in range(count)]
