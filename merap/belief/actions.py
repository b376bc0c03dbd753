"""What each action can lead to, as tables that all hypotheses about the dynamics share.

An action's outcome in a state depends on which of its moves are open there and on three
classes: the environment's attributes, the capability's actions, and nothing else. So a table
per action answers for every combination, whose models are never built.

Axes: P locations, Q modes, S = P * Q states, U attribute classes, V capability classes,
G disturbances of the outcome probabilities, R = 2^k patterns of an action's k moves (bit j is set if
move j is open), K slots. Slot 0 stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from merap.belief.steps import scope_of
from merap.concerns.combination import Capability, DeclaredCombination
from merap.concerns.external_action import ExternalAction
from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.program.expressions import evaluate

MAX_MOVES = 10
NEGLIGIBLE = 1e-12


@dataclass(frozen=True, eq=False)
class ActionTable:
    """One declared action.

    Attributes:
        moves: k edge labels that it can go along.
        target: int64 [S, K], the state a slot leads to; the state itself where it leads nowhere.
        prob: float64 [U, V, G, S, R, K], sums to 1 where the action is enabled, else to 0.
        enabled: bool [V, S, R].
    """

    moves: tuple[int, ...]
    target: Ints
    prob: Floats
    enabled: Bools

    @cached_property
    def telling(self) -> Bools:
        """bool [S]: whether being enabled there tells hypotheses apart."""
        flat = self.enabled.transpose(1, 0, 2).reshape(len(self.target), -1)
        return np.asarray(flat.any(axis=1) & ~flat.all(axis=1))


def action_tables(combinations: Sequence[Sequence[DeclaredCombination]]) -> tuple[ActionTable, ...]:
    """A table for each declared action, without disturbance (G = 1).

    Args:
        combinations: [U][V], one combination for every attribute and capability class.

    Raises:
        InputError: an action has more than `MAX_MOVES` moves.
    """
    names = combinations[0][0].actions
    return tuple(_action_table(combinations, name) for name in names)


def _action_table(combinations: Sequence[Sequence[DeclaredCombination]], name: str) -> ActionTable:
    capabilities = [combination.capability for combination in combinations[0]]
    external = [_external(capability, name) for capability in capabilities]
    if any(action is not None for action in external):
        return _external_table(combinations, name, external)
    return _innate_table(combinations, name)


def _external(capability: Capability, name: str) -> ExternalAction | None:
    return next((action for action in capability.external if action.name == name), None)


def _external_table(
    combinations: Sequence[Sequence[DeclaredCombination]], name: str, actions: Sequence[ExternalAction | None]
) -> ActionTable:
    present = [action for action in actions if action is not None]
    labels = [outcome.move for action in present for outcome in action.outcomes if outcome.move is not None]
    moves = tuple(dict.fromkeys(labels))
    if len(moves) > MAX_MOVES:
        raise InputError(f"action {name} has {len(moves)} moves, a belief can follow {MAX_MOVES} at most")
    space, num_modes = combinations[0][0].space, len(combinations[0][0].modes)
    here, mode = np.divmod(np.arange(space.num_locations * num_modes), num_modes)
    ends = np.stack([here, *(_along(space.target[here, move], here) for move in moves)], axis=1)
    shape = (len(combinations), len(actions), len(here), 2 ** len(moves))
    prob = np.zeros((*shape, 1 + len(moves)))
    enabled = np.zeros(shape[1:], dtype=np.bool_)
    for v, action in enumerate(actions):
        if action is None:
            continue
        enabled[v] = _enabled(combinations[0][v].capability, action, moves, mode, num_modes)
        for u, row in enumerate(combinations):
            prob[u, v] = _outcomes(row[v], action, moves, ends, mode) * enabled[v][..., np.newaxis]
    return ActionTable(moves, ends * num_modes + mode[:, np.newaxis], prob[:, :, np.newaxis], enabled)


def _along(target: Ints, here: Ints) -> Ints:
    return np.where(target >= 0, target, here)


def _enabled(
    capability: Capability, action: ExternalAction, moves: tuple[int, ...], mode: Ints, num_modes: int
) -> Bools:
    """bool [S, R]."""
    intended = action.outcomes[0].move
    possible = np.ones(2 ** len(moves), dtype=np.bool_)
    if action.on_blocked == "disable" and intended is not None:
        possible = _is_open(moves.index(intended), len(moves))
    return capability.terminal(num_modes)[mode][:, np.newaxis] & possible


def _is_open(bit: int, num_moves: int) -> Bools:
    """bool [R]."""
    mask: Bools = (np.arange(2**num_moves) >> bit) & 1 == 1
    return mask


def _outcomes(
    combination: DeclaredCombination, action: ExternalAction, moves: tuple[int, ...], ends: Ints, mode: Ints
) -> Floats:
    """float64 [S, R, K]: rules 1 and 2 of composition, a blocked move stays."""
    num_states, num_patterns = len(mode), 2 ** len(moves)
    here = np.repeat(ends[:, 0], num_patterns)
    modes = np.repeat(mode, num_patterns)
    intended = here
    if action.outcomes[0].move is not None:
        slot = 1 + moves.index(action.outcomes[0].move)
        is_open = np.tile(_is_open(slot - 1, len(moves)), num_states)
        intended = np.where(is_open, np.repeat(ends[:, slot], num_patterns), here)
    scope = scope_of(combination, here, modes, intended, modes)
    prob = np.zeros((num_states, num_patterns, 1 + len(moves)))
    for outcome in action.outcomes:
        given = np.broadcast_to(evaluate(outcome.probability, scope), here.shape)
        mass = given.reshape(num_states, num_patterns).astype(np.float64)
        if outcome.move is None:
            prob[..., 0] += mass
            continue
        slot = 1 + moves.index(outcome.move)
        is_open = _is_open(slot - 1, len(moves))
        prob[..., slot] += mass * is_open
        prob[..., 0] += mass * ~is_open
    prob[np.abs(prob) < NEGLIGIBLE] = 0.0
    return prob


def _innate_table(combinations: Sequence[Sequence[DeclaredCombination]], name: str) -> ActionTable:
    """Innate actions and `start_*`: they change the mode alone."""
    first = combinations[0][0]
    num_modes = len(first.modes)
    states = np.arange(first.space.num_locations * num_modes)
    mode = states % num_modes
    # Slot 0 keeps the mode; slot 1 + q leads to mode q.
    target = np.column_stack([states, *(states - mode + q for q in range(num_modes))])
    rows = np.stack([_mode_rows(combination.capability, name, num_modes) for combination in combinations[0]])
    prob = np.zeros((len(rows), len(states), 1 + num_modes))
    prob[..., 1:] = rows[:, mode]
    same = (np.arange(len(rows))[:, np.newaxis], states, 1 + mode)
    prob[..., 0], prob[same] = prob[same], 0.0
    enabled = prob.sum(axis=2) > 0
    shape = (len(combinations), len(rows), 1, len(states), 1, 1 + num_modes)
    repeated = np.broadcast_to(prob[:, np.newaxis, :, np.newaxis], shape)
    return ActionTable((), target, np.ascontiguousarray(repeated), enabled[..., np.newaxis])


def _mode_rows(capability: Capability, name: str, num_modes: int) -> Floats:
    """float64 [Q, Q], the distribution of the next mode; zero where the action is undefined."""
    rows = np.zeros((num_modes, num_modes))
    innate = capability.innate
    if innate is None:
        return rows
    for action in innate.actions:
        if action.name == name:
            for mode, row in action.chances.items():
                rows[mode, list(row)] = [float(probability) for probability in row.values()]
    if innate.restart and name == innate.start_action:
        rows[sorted(innate.terminal), innate.entry] = 1.0
    return rows
