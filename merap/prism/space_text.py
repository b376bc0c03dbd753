"""The module `space`: it owns the location and draws every outcome of external actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.concerns.combination import ExternalAction
from merap.concerns.space import Space
from merap.mdp.model import Bools, Ints
from merap.prism.lines import Command, Formula, VariableLine
from merap.prism.location_text import cases, predicate
from merap.prism.step_text import Branch, StepWriter
from merap.prism.terms import bare

KEY_WIDTH = 10


@dataclass(frozen=True)
class SpaceText:
    """The content of `space.prism.j2`.

    Attributes:
        location_key: comment lines that number a graph's locations.
        moves: formulas of the moves.
        variables: of the location.
        commands: one for each external action.
    """

    location_key: list[str]
    moves: list[Formula]
    variables: list[VariableLine]
    commands: list[Command]


def space_text(writer: StepWriter, starts: Bools) -> SpaceText:
    """The module for one environment and capability; `starts` is bool [P]."""
    combination = writer.combination
    actions = combination.capability.external
    used = {outcome.move for action in actions for outcome in action.outcomes if outcome.move is not None}
    moves = {move: _move_formulas(writer, move) for move in sorted(used)}
    return SpaceText(
        location_key=_location_key(combination.space),
        moves=[formula for formulas in moves.values() for formula in formulas],
        variables=_variables(combination.space, starts),
        commands=[
            Command(action.name, _guard(writer, action), _updates(writer, action, moves))
            for action in actions
        ],
    )


def _location_key(space: Space) -> list[str]:
    if space.shape is not None:
        return []
    pairs = [f"{index} {name}" for index, name in enumerate(space.locations)]
    return [", ".join(pairs[begin : begin + KEY_WIDTH]) for begin in range(0, len(pairs), KEY_WIDTH)]


def _variables(space: Space, starts: Bools) -> list[VariableLine]:
    first = space.valuations[np.flatnonzero(starts)]
    return [
        VariableLine(name, max(1, int(column.max())), int(values[0]) if len(values) == 1 else None)
        for name, column, values in zip(space.variable_names, space.valuations.T, first.T, strict=True)
    ]


def _move_formulas(writer: StepWriter, move: int) -> list[Formula]:
    """`open_<label>`: where the move is possible; `<variable>_<label>`: where it leads."""
    space = writer.space
    label = space.moves[move]
    is_open = writer.combination.passable[:, move]
    there = space.valuations[writer.formulas.there(move)]
    formulas = [Formula(f"open_{label}", bare(predicate(space, is_open)))]
    for name, before, after in zip(space.variable_names, space.valuations.T, there.T, strict=True):
        if not np.array_equal(before, after):
            formulas.append(Formula(f"{name}_{label}", _successor(space, name, label, before, after)))
    return formulas


def _successor(space: Space, name: str, label: str, before: Ints, after: Ints) -> str:
    shifts = np.setdiff1d(after - before, [0])
    if len(shifts) == 1 and space.shape is not None:
        return f"open_{label} ? {name}{shifts[0]:+d} : {name}"
    targets, index = np.unique(np.where(before == after, -1, after), return_inverse=True)
    return bare(cases(space, [name if target < 0 else str(target) for target in targets], index))


def _guard(writer: StepWriter, action: ExternalAction) -> str:
    intended = action.outcomes[0].move
    if action.on_blocked == "disable" and intended is not None:
        return f"open_{writer.space.moves[intended]}"
    return "true"


def _updates(writer: StepWriter, action: ExternalAction, moves: dict[int, list[Formula]]) -> str:
    branches = writer.external(action).branches
    if len(branches) == 1:
        return _update(writer.space, branches[0], moves)
    return " + ".join(f"{branch.probability} : {_update(writer.space, branch, moves)}" for branch in branches)


def _update(space: Space, branch: Branch, moves: dict[int, list[Formula]]) -> str:
    if branch.move is None:
        return "true"
    label = space.moves[branch.move]
    names = {formula.name for formula in moves[branch.move]}
    changed = [name for name in space.variable_names if f"{name}_{label}" in names]
    return " & ".join(f"({name}'={name}_{label})" for name in changed) or "true"
