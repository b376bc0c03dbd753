"""The values of an attribute as colours of the locations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, to_hex

from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Attribute
from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.report.style import INK, Entry, heading, mark

# Light enough for marks on top; brightness falls with the value, so it reads in grey as well.
_COLOURS: Colormap = LinearSegmentedColormap.from_list("merap", ["#FFFDF2", "#F7DE9C", "#D9A648"])
_MOST_STEPS = 8


@dataclass(frozen=True, eq=False)
class Colouring:
    """One attribute on the map.

    Attributes:
        face: float64 [P, 4], colour of each location.
        dotted: bool [P], where a truth value holds, which is dotted as well.
        entries: lines of the legend about it; empty if there is a scale.
        scale: for a colour bar; None if the legend says it all.
        title: title of the colour bar.
    """

    face: Floats
    dotted: Bools
    entries: tuple[Entry, ...]
    scale: ScalarMappable | None
    title: str


def colour_by(combination: DeclaredCombination, name: str | None) -> Colouring:
    """Colour locations by an attribute, or by the first that varies.

    Args:
        combination: its environment says the values.
        name: name of the attribute; None takes the first that is not the same everywhere, if any.

    Raises:
        InputError: there is no such attribute.
    """
    attribute = _choose(combination, name)
    size = combination.space.num_locations
    if attribute is None:
        return Colouring(np.ones((size, 4)), np.zeros(size, dtype=np.bool_), (), None, "")
    levels = np.unique(attribute.values)
    ends = [*levels[[0, -1]], *(end for end in (attribute.low, attribute.high) if np.isfinite(end))]
    norm = Normalize(min(ends), max(ends))
    shape = "o" if combination.space.shape is None else "s"
    face = np.asarray(_COLOURS(norm(attribute.values)), dtype=np.float64)
    dotted = (attribute.values != 0) & (attribute.kind == "bool")
    if len(levels) > _MOST_STEPS or attribute.kind == "real":
        return Colouring(face, dotted, (), ScalarMappable(norm, _COLOURS), attribute.name)
    return Colouring(face, dotted, _entries(attribute, levels, norm, shape), None, "")


def _choose(combination: DeclaredCombination, name: str | None) -> Attribute | None:
    attributes = {attribute.name: attribute for attribute in combination.environment.attributes}
    if name is None:
        return next((a for a in attributes.values() if np.ptp(a.values) > 0), None)
    if name not in attributes:
        allowed = ", ".join(attributes) or "none is declared"
        raise InputError(f"unknown attribute {name!r}; allowed: {allowed}")
    return attributes[name]


def _entries(attribute: Attribute, levels: Floats, norm: Normalize, shape: str) -> tuple[Entry, ...]:
    entries = [heading(attribute.name)]
    for level in levels.tolist():
        marks = [mark(shape, to_hex(_COLOURS(norm(level))), edge=INK)]
        text = f"{level:g}"
        if attribute.kind == "bool":
            text = "yes" if level else "no"
            marks += [mark(".", INK, size=0.35)] if level else []
        entries.append((tuple(marks), f"{attribute.name} = {text}"))
    return tuple(entries)
