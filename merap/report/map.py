"""Maps: a combination as a picture, with a policy and paths on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeGuard

from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from merap.concerns.combination import Combination, DeclaredCombination
from merap.errors import InputError
from merap.families.models import explored
from merap.mdp.model import Floats, TabularMDP
from merap.report.colouring import Colouring, colour_by
from merap.report.diagrams import process_diagrams
from merap.report.doors import draw_doors
from merap.report.edges import draw_edges
from merap.report.locations import draw_locations
from merap.report.moves import draw_policy
from merap.report.path import RoutePath
from merap.report.routes import draw_routes
from merap.report.sheet import Panel, close_sheet, diagram_page, open_sheet
from merap.report.style import LINES, Entry, Line


def has_map(combination: Combination) -> TypeGuard[DeclaredCombination]:
    """Return whether a combination says where things are."""
    return isinstance(combination, DeclaredCombination) and bool(combination.program.location)


def draw_combination(
    combination: Combination,
    *,
    attribute: str | None = None,
    policy: Floats | None = None,
    paths: Sequence[RoutePath] = (),
    title: str | None = None,
) -> Figure:
    """Draw the map of a combination, if it has one, and its processes as state diagrams.

    The arguments are those of `draw_map`; without a map policy and paths are not drawn.

    Raises:
        InputError: there is no such attribute.
        ModelError: the policy has another shape.
    """
    if has_map(combination):
        return draw_map(combination, attribute=attribute, policy=policy, paths=paths, title=title)
    if attribute is not None:
        raise InputError(f"{combination.name} has no locations, so there is no attribute {attribute!r}")
    return diagram_page(title or combination.name, process_diagrams(combination, explored(combination)))


def draw_map(
    combination: DeclaredCombination,
    *,
    attribute: str | None = None,
    policy: Floats | None = None,
    paths: Sequence[RoutePath] = (),
    title: str | None = None,
) -> Figure:
    """Draw the space of a combination, what its three concerns say about it, and its processes.

    Args:
        combination: the one to draw.
        attribute: colours the locations; None takes the first that is not the same everywhere.
        policy: float [S, A], for the states and actions of `explored(combination)`, drawn as arrows; None
            draws none.
        paths: drawn as lines, next to each other.
        title: None takes the combination's name.

    Raises:
        InputError: there is no such attribute.
        ModelError: the policy has another shape.
    """
    mdp, colouring = explored(combination), colour_by(combination, attribute)
    sheet = open_sheet(combination, panels=1)
    entries = _draw_base(sheet.panels[0], colouring, mdp)
    if policy is not None:
        entries += draw_policy(sheet.panels[0], mdp, policy)
    if paths:
        entries += draw_routes(
            sheet.panels[0],
            list(zip(paths, _styles(len(paths)), strict=True)),
            beside=policy is not None,
        )
    return close_sheet(
        sheet,
        title=title or combination.name,
        entries=entries,
        colour_bar=_bar(colouring),
        diagrams=process_diagrams(combination, mdp),
    )


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
    mdp, colouring = explored(combination), colour_by(combination, attribute)
    sheet = open_sheet(combination, panels=2)
    named = (replace(before, label="before"), replace(after, label="after"))
    entries: list[Entry] = []
    for panel, path, style in zip(sheet.panels, named, _styles(2), strict=True):
        entries += [*_draw_base(panel, colouring, mdp), *draw_routes(panel, [(path, style)])]
    return close_sheet(
        sheet,
        title=title or combination.name,
        panel_titles=("Before adaptation", "After adaptation"),
        entries=entries,
        colour_bar=_bar(colouring),
    )


def _draw_base(panel: Panel, colouring: Colouring, mdp: TabularMDP) -> list[Entry]:
    edges = [*draw_edges(panel), *draw_doors(panel, mdp)]
    return [*draw_locations(panel, colouring, mdp), *edges, *colouring.entries]


def _bar(colouring: Colouring) -> tuple[ScalarMappable, str] | None:
    return None if colouring.scale is None else (colouring.scale, colouring.title)


def _styles(count: int) -> list[Line]:
    """Return a style for each path; the last is the solid one."""
    return [LINES[(count - 1 - index) % len(LINES)] for index in range(count)]
