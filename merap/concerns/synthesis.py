"""Composition by definition: the MDP of a combination as arrays, without any text.

The rules have numbers: 1 external actions, 2 where they are enabled, 3 innate actions,
4 rewards and ends. This is the second route beside PRISM text and Storm.
Axes: P locations, Q modes, A actions, B branches. State (p, q) has index p * Q + q; state
(p, q, done) has index 2 * (p * Q + q) + done.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.space import Space
from merap.concerns.steps import Steps, holds_in_states, require_places_and_modes, scope_of
from merap.errors import InputError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.assembly import Branches, assemble
from merap.mdp.graph import reachable_along
from merap.mdp.matching import match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import (
    COMPLETE_LABEL,
    END_ACTION,
    FLAG_VARIABLE,
    GOAL_LABEL,
    MODE_VARIABLE,
    UNSAFE_LABEL,
)
from merap.program.expressions import evaluate


def synthesise(combination: DeclaredCombination) -> TabularMDP:
    """The whole MDP of a combination, over its reachable states (p, q, done).

    Raises:
        InputError: a reachable state that is not complete has no action; names it.
    """
    return attach(synthesise_pair(combination), combination)


def synthesise_pair(combination: DeclaredCombination, starts: Bools | None = None) -> TabularMDP:
    """Environment and capability without objective: rules 1 to 3 on all of P x Q, no reward.

    Every state has the action `end` beside its own, so that none is without an action.

    Args:
        combination: whose objective gives no more than the start distribution.
        starts: bool [P], start locations, equally likely, in place of that distribution.
    """
    require_places_and_modes(combination)
    start = combination.objective.start if starts is None else starts / np.count_nonzero(starts)
    num_modes = len(combination.modes)
    num_states = combination.space.num_locations * num_modes
    everywhere = np.arange(num_states)
    idle = _branches(everywhere, combination.action_names.index(END_ACTION), everywhere, np.ones(num_states))
    parts = [idle, *_external(combination), *_innate(combination)]
    return assemble(
        Branches(*(np.concatenate(columns) for columns in zip(*parts, strict=True))),
        initial=_initial(combination, start),
        labels={},
        valuations=pair_valuations(combination),
        variable_names=(*combination.space.variable_names, MODE_VARIABLE),
        action_names=combination.action_names,
    )


def pair_valuations(combination: DeclaredCombination) -> Ints:
    """int64 [P * Q, V]: the values of the location variables and the mode, in canonical order."""
    num_modes = len(combination.modes)
    locations = np.repeat(combination.space.valuations, num_modes, axis=0)
    modes = np.tile(np.arange(num_modes), combination.space.num_locations)
    return np.column_stack([locations, modes])


def _initial(combination: DeclaredCombination, start: Floats) -> Floats:
    initial = np.zeros((combination.space.num_locations, len(combination.modes)))
    initial[:, combination.capability.initial_mode] = start
    return initial.ravel()


Columns = tuple[Ints, Ints, Ints, Floats, Floats]


def _branches(state: Ints, action: int, target: Ints, prob: Floats) -> Columns:
    return state, np.full(len(state), action), target, prob, np.zeros(len(state))


def _external(combination: DeclaredCombination) -> Iterator[Columns]:
    num_modes = len(combination.modes)
    terminal = np.flatnonzero(combination.capability.terminal(num_modes))
    passable = combination.passable
    for action in combination.capability.external:
        here, mode = _grid(_where_enabled(action, passable), terminal)
        intended = _successor(combination.space, passable, here, action.outcomes[0])
        scope = scope_of(combination, here, mode, intended, mode)
        for outcome in action.outcomes:
            there = _successor(combination.space, passable, here, outcome)
            prob = np.broadcast_to(evaluate(outcome.probability, scope), here.shape).astype(np.float64)
            index = combination.action_names.index(action.name)
            yield _branches(here * num_modes + mode, index, there * num_modes + mode, prob)


def _successor(space: Space, passable: Bools, here: Ints, outcome: Outcome) -> Ints:
    """Where an outcome leads: rule 1, a blocked move stays."""
    if outcome.move is None:
        return here
    return np.where(passable[here, outcome.move], space.target[here, outcome.move], here)


def _where_enabled(action: ExternalAction, passable: Bools) -> Ints:
    intended = action.outcomes[0].move
    if action.on_blocked == "disable" and intended is not None:
        return np.flatnonzero(passable[:, intended])
    return np.arange(len(passable))


def _innate(combination: DeclaredCombination) -> Iterator[Columns]:
    innate = combination.capability.innate
    if innate is None:
        return
    num_modes = len(combination.modes)
    locations = np.arange(combination.space.num_locations) * num_modes
    for action in innate.actions:
        index = combination.action_names.index(action.name)
        for mode, row in action.transitions.items():
            for successor, probability in row.items():
                prob = np.full(len(locations), float(probability))
                yield _branches(locations + mode, index, locations + successor, prob)
    if innate.restart:
        index = combination.action_names.index(innate.start_action)
        for mode in sorted(innate.terminal):
            yield _branches(locations + mode, index, locations + innate.entry, np.ones(len(locations)))


def attach(pair: TabularMDP, combination: DeclaredCombination) -> TabularMDP:
    """Put the objective on a pair's arrays (rule 4), restricted to what is reachable.

    Args:
        pair: the MDP of environment and capability in any numbering, from `synthesise_pair`
            or from Storm, with every state that is reachable under this objective. Its
            rewards and its action `end` are not used.
        combination: whose objective is attached.

    Returns:
        States (p, q, done) with labels `done`, `goal` and, if declared, `unsafe`.

    Raises:
        InputError: a reachable state that is not complete has no action; names it.
    """
    require_places_and_modes(combination)
    complete = _complete_in(combination)
    branches = _with_objective(pair, combination, complete)
    initial = np.zeros(2 * len(complete))
    initial[0::2] = _initial(combination, combination.objective.start)
    labels = _labels(combination, complete)
    kept = reachable_along(branches.state, branches.target, initial > 0)
    _require_an_action(combination, kept, branches)
    return assemble(
        _renumbered(branches, kept),
        initial=initial[kept],
        labels={name: mask[kept] for name, mask in labels.items()},
        valuations=_whole_valuations(combination)[kept],
        variable_names=(*combination.space.variable_names, MODE_VARIABLE, FLAG_VARIABLE),
        action_names=combination.action_names,
    )


def attach_everywhere(pair: TabularMDP, combination: DeclaredCombination) -> TabularMDP:
    """Like `attach`, over all of P x Q x {0, 1}: state (p, q, done) has number 2 * (p * Q + q) + done.

    States that can't be reached from the start keep their rows; they may have no action.

    Args:
        pair: as in `attach`, with all states of P x Q.
        combination: whose objective is attached.

    Raises:
        ModelError: a reachable state has no action.
    """
    require_places_and_modes(combination)
    complete = _complete_in(combination)
    initial = np.zeros(2 * len(complete))
    initial[0::2] = _initial(combination, combination.objective.start)
    return assemble(
        _with_objective(pair, combination, complete),
        initial=initial,
        labels=_labels(combination, complete),
        valuations=_whole_valuations(combination),
        variable_names=(*combination.space.variable_names, MODE_VARIABLE, FLAG_VARIABLE),
        action_names=combination.action_names,
    )


def _with_objective(pair: TabularMDP, combination: DeclaredCombination, complete: Bools) -> Branches:
    end = combination.action_names.index(END_ACTION)
    state, action, target, prob = _in_canonical_order(pair, combination)
    keep = (action != end) & ~complete[state]
    state, action, target, prob = state[keep], action[keep], target[keep], prob[keep]
    step = Steps(combination, state, action, target)
    ended = np.zeros(len(state), dtype=np.int64)
    if combination.objective.ends_after is not None:
        ended = step.holds(combination.objective.ends_after).astype(np.int64)
    closed = np.concatenate([2 * np.flatnonzero(complete), 2 * np.arange(len(complete)) + 1])
    return Branches(
        state=np.concatenate([2 * state, closed]),
        action=np.concatenate([action, np.full(len(closed), end)]),
        target=np.concatenate([2 * target + ended, closed]),
        prob=np.concatenate([prob, np.ones(len(closed))]),
        reward=np.concatenate([step.rewards(), np.zeros(len(closed))]),
    )


def _in_canonical_order(
    pair: TabularMDP, combination: DeclaredCombination
) -> tuple[Ints, Ints, Ints, Floats]:
    """A pair's branches as columns (state, action, target, probability), states as p * Q + q."""
    variables = (*combination.space.variable_names, MODE_VARIABLE)
    index = match_rows(align_variables(pair, variables), pair_valuations(combination))
    action = align_actions(pair, combination.action_names)[pair.choice_action]
    state = index[pair.choice_state][pair.branch_choice]
    return state, action[pair.branch_choice], index[pair.branch_target], pair.branch_prob


def _renumbered(branches: Branches, kept: Bools) -> Branches:
    new_index = np.cumsum(kept) - 1
    inside = kept[branches.state]
    return Branches(
        new_index[branches.state[inside]],
        branches.action[inside],
        new_index[branches.target[inside]],
        branches.prob[inside],
        branches.reward[inside],
    )


def _require_an_action(combination: DeclaredCombination, kept: Bools, branches: Branches) -> None:
    has_action = np.zeros(len(kept), dtype=np.bool_)
    has_action[branches.state] = True
    stuck = np.flatnonzero(kept & ~has_action)
    if len(stuck):
        location, mode = divmod(int(stuck[0]) // 2, len(combination.modes))
        raise InputError(
            f"{combination.name}: the state at location {combination.space.locations[location]}, mode "
            f"{combination.modes[mode]} can be reached, is not complete and has no action; "
            "add an action that stays, or end the task there"
        )


def _whole_valuations(combination: DeclaredCombination) -> Ints:
    pairs = np.repeat(pair_valuations(combination), 2, axis=0)
    return np.column_stack([pairs, np.tile([0, 1], len(pairs) // 2)])


def _labels(combination: DeclaredCombination, complete: Bools) -> dict[str, Bools]:
    flag = np.tile([False, True], len(complete))
    labels = {
        COMPLETE_LABEL: flag | np.repeat(complete, 2),
        GOAL_LABEL: np.repeat(_goal(combination), 2),
    }
    if combination.objective.unsafe is not None:
        labels[UNSAFE_LABEL] = np.repeat(holds_in_states(combination, combination.objective.unsafe), 2)
    return labels


def _goal(combination: DeclaredCombination) -> Bools:
    goal = combination.objective.goal
    if goal is None:
        return np.zeros(combination.space.num_locations * len(combination.modes), dtype=np.bool_)
    return holds_in_states(combination, goal)


def _complete_in(combination: DeclaredCombination) -> Bools:
    if combination.objective.ends_in is None:
        return np.zeros(combination.space.num_locations * len(combination.modes), dtype=np.bool_)
    return holds_in_states(combination, combination.objective.ends_in)


def _grid(locations: Ints, modes: Ints) -> tuple[Ints, Ints]:
    """Every location with every mode, as two columns."""
    return np.repeat(locations, len(modes)), np.tile(modes, len(locations))
