"""Draw a policy on a map: the likeliest action at each location, in each mode that can move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba_array

from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Space
from merap.errors import ModelError
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, MODE_VARIABLE
from merap.report.geometry import arrows, right_of, unit
from merap.report.locations import locations_of
from merap.report.sheet import Panel
from merap.report.style import INK, ORANGE, SKY_BLUE, Entry, heading, mark

# Faces of the arrows of the first, second, ... mode; all have a dark outline.
_FACES = (INK, "#FFFFFF", ORANGE, SKY_BLUE)
_STAY, _INNATE = -1, -2


@dataclass(frozen=True, eq=False)
class Moves:
    """The likeliest action at each location in one mode.

    Attributes:
        label: int64 [P], the edge label it is meant to move along; -1 stays, -2 is innate.
        prob: float64 [P], how likely it is; 0 where nobody can be or the policy says nothing.
    """

    label: Ints
    prob: Floats


def likeliest_moves(combination: DeclaredCombination, mdp: TabularMDP, policy: Floats) -> dict[int, Moves]:
    """Return the most probable action of a policy at each location, for each mode that can move.

    Where states differ in more than location and mode, the mean over them counts.

    Args:
        combination: declares locations, modes and actions.
        mdp: whose states and actions index the policy; its complete states are not looked at.
        policy: float [S, A].

    Raises:
        ModelError: the policy has another shape.
    """
    if policy.shape != (mdp.num_states, mdp.num_actions):
        raise ModelError(f"the policy has shape {policy.shape}, not {(mdp.num_states, mdp.num_actions)}")
    going = ~mdp.labels[COMPLETE_LABEL]
    place, mode = locations_of(combination, mdp)[going], _modes_of(mdp)[going]
    columns = [mdp.action_names.index(name) for name in combination.actions if name in mdp.action_names]
    rows = policy[going][:, columns]
    intended = np.full(len(columns), _INNATE)
    names = [mdp.action_names[column] for column in columns]
    for action in combination.capability.external:
        if action.name in names:
            move = action.outcomes[0].move
            intended[names.index(action.name)] = _STAY if move is None else move
    closed = combination.environment.blocked | combination.capability.no_entry
    size = combination.space.num_locations

    def in_mode(number: int) -> Moves:
        own = mode == number
        sums = np.zeros((size, len(columns)))
        np.add.at(sums, place[own], rows[own])
        mean = sums / np.maximum(np.bincount(place[own], minlength=size), 1)[:, None]
        return Moves(intended[mean.argmax(axis=1)], np.where(closed, 0.0, mean.max(axis=1)))

    terminal = np.flatnonzero(combination.capability.terminal(max(len(combination.modes), 1)))
    initial = combination.capability.initial_mode
    return {one: in_mode(one) for one in sorted(terminal.tolist(), key=lambda one: (one != initial, one))}


def _modes_of(mdp: TabularMDP) -> Ints:
    """int64 [S]; 0 where the only mode is no variable."""
    if MODE_VARIABLE not in mdp.variable_names:
        return np.zeros(mdp.num_states, dtype=np.int64)
    return mdp.valuations[:, mdp.variable_names.index(MODE_VARIABLE)]


def draw_policy(panel: Panel, mdp: TabularMDP, policy: Floats) -> list[Entry]:
    """Draw an arrow for a move, a square for staying, a diamond for an innate action.

    Each terminal mode has arrows of its own, the initial mode first; the paler and thinner, the
    less likely.

    Raises:
        ModelError: the policy has another shape.
    """
    combination = panel.combination
    found = likeliest_moves(combination, mdp, policy)
    entries = [heading("Policy (paler: less often)")]
    for slot, (mode, moves) in enumerate(found.items()):
        face = _FACES[slot % len(_FACES)]
        side = slot - (len(found) - 1) / 2
        _draw_mode(panel, moves, face, side)
        suffix = f" in mode {combination.modes[mode]}" if len(combination.modes) > 1 else ""
        shapes = {">": "moves", "s": "stays", "D": "innate action"}
        present = _present(moves)
        entries += [
            ((mark(shape, face, edge=INK, size=0.65),), f"{meaning}{suffix}")
            for shape, meaning in shapes.items()
            if shape in present
        ]
    return entries


def _present(moves: Moves) -> set[str]:
    labels = moves.label[moves.prob > 0]
    found = {">": labels >= 0, "s": labels == _STAY, "D": labels == _INNATE}
    return {shape for shape, mask in found.items() if mask.any()}


def _draw_mode(panel: Panel, moves: Moves, face: str, side: float) -> None:
    combination, is_grid, radius = panel.combination, panel.extent.is_grid, panel.extent.radius
    shown = moves.prob > 0
    width = (0.1 if is_grid else 0.22) * radius * (0.5 + moves.prob)
    gap = (0.5 if is_grid else 0.84) * radius
    going = np.flatnonzero(shown & (moves.label >= 0))
    directions = _directions(panel, going, moves.label[going])
    length = (1.15 if is_grid else 2.4) * radius
    tails = combination.space.positions[going] + side * gap * right_of(directions)
    tails = tails + directions * (-length / 2 if is_grid else 0.8 * radius)
    outlines = [*arrows(tails, directions, length, width[going])]
    chosen = [*going]
    for kind, corners in ((_STAY, _SQUARE), (_INNATE, _DIAMOND)):
        standing = np.flatnonzero(shown & (moves.label == kind))
        centres = combination.space.positions[standing] + np.array([side * gap, 0.0])
        size = (0.2 if is_grid else 0.34) * radius
        outlines += [*(centres[:, None] + size * corners)]
        chosen += [*standing]
    panel.axes.add_collection(
        PolyCollection(
            outlines,
            facecolors=_faded(face, moves.prob[chosen]),
            edgecolors=_faded(INK, moves.prob[chosen]),
            linewidths=0.8,
            zorder=5,
            gid="policy",
        )
    )


_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_DIAMOND = np.array([[-1.3, 0.0], [0.0, -1.3], [1.3, 0.0], [0.0, 1.3]])


def _faded(colour: str, prob: Floats) -> Floats:
    """Return float64 [M, 4], the colour, mixed with white the less likely it is."""
    strength = (0.2 + 0.8 * np.clip(prob, 0, 1))[:, None]
    mixed: Floats = to_rgba_array(colour) * strength + (1 - strength)
    return mixed


def _directions(panel: Panel, here: Ints, label: Ints) -> Floats:
    """Return float64 [M, 2], where the edge with a label goes; where there is none, its usual direction."""
    space = panel.combination.space
    target = space.target[here, label]
    usual = np.array([_usual_direction(space, move) for move in range(len(space.moves))]).reshape(-1, 2)
    along = usual[label]
    for row in np.flatnonzero(target >= 0):
        first, second = panel.lines.between(int(here[row]), int(target[row]))[:2]
        along[row] = unit(second - first)
    return along


def _usual_direction(space: Space, move: int) -> Floats:
    sources = np.flatnonzero(space.target[:, move] >= 0)
    shifts = space.positions[space.target[sources, move]] - space.positions[sources]
    # A sum, as a label without edges has none to average.
    return unit(unit(shifts).sum(axis=0))
