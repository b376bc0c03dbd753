"""Evaluate expressions, conditions and rewards on steps (s, a, s') as columns.

Axes: P locations, Q modes, B steps. State (p, q) has index p * Q + q.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from merap.concerns.combination import Combination, Condition, DeclaredCombination
from merap.concerns.location_tables import step_scope
from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.program.expressions import TRUE, Column, Expression, evaluate, variables


def beyond_places_and_modes(combination: Combination) -> str | None:
    """Return why arrays over locations and modes can't hold the states of a combination; None: they can."""
    if not isinstance(combination, DeclaredCombination):
        return "it is PRISM text"
    if not combination.space.variable_names:
        return "it has no space"
    changing = [one.name for one in combination.processes]
    if changing:
        return f"{changing[0]} changes beside location and mode"
    innate = combination.capability.innate
    asking = [action.name for action in combination.capability.external if action.requires != TRUE]
    asking += [innate.name] if innate is not None and innate.requires != TRUE else []
    return f"{asking[0]} requires something of the state" if asking else None


def require_places_and_modes(combination: Combination) -> None:
    """Refuse a combination of which arrays over locations and modes can't hold the states.

    Raises:
        InputError: says why.
    """
    why = beyond_places_and_modes(combination)
    if why is not None:
        raise InputError(
            f"{combination.name}: belief and shield know nothing but locations and modes so far, and {why}"
        )


class Steps:
    """Steps (s, a, s') as columns of length B, on which conditions and rules are evaluated."""

    def __init__(self, combination: DeclaredCombination, state: Ints, action: Ints, target: Ints) -> None:
        require_places_and_modes(combination)
        num_modes = len(combination.modes)
        self.combination = combination
        self.action = action
        self.here, self.mode = np.divmod(state, num_modes)
        self.there, self.mode_there = np.divmod(target, num_modes)
        self.scope = scope_of(combination, self.here, self.mode, self.there, self.mode_there)

    def holds(self, condition: Condition) -> Bools:
        """bool [B]."""
        mask = np.ones(len(self.here), dtype=np.bool_)
        if condition.actions is not None:
            names = self.combination.action_names
            mask = np.array([name in condition.actions for name in names])[self.action]
        mask[mask] = self._evaluated(condition.where, mask)
        return mask

    def rewards(self) -> Floats:
        """float64 [B]: the value of the first rule that holds, 0 if none does."""
        rewards = np.zeros(len(self.here))
        undecided = np.ones(len(self.here), dtype=np.bool_)
        for rule in self.combination.objective.rules:
            matching = undecided & self.holds(rule.condition)
            rewards[matching] = self._evaluated(rule.value, matching)
            undecided &= ~matching
        return rewards

    def _evaluated(self, expression: Expression, mask: Bools) -> npt.NDArray[Any]:
        """The value in the steps of `mask` alone: elsewhere it may be a division by zero."""
        read = {variable.name for variable in variables(expression)}
        return evaluate(expression, {name: self.scope[name][mask] for name in read})


def holds_in_states(combination: DeclaredCombination, where: Expression) -> Bools:
    """bool [P * Q]: where a condition on states holds."""
    states = np.arange(combination.space.num_locations * len(combination.modes))
    return Steps(combination, states, np.zeros_like(states), states).holds(Condition(where=where))


def scope_of(
    combination: DeclaredCombination, here: Ints, mode: Ints, there: Ints, mode_there: Ints
) -> dict[str, Column]:
    """Return the columns that expressions read in B steps; those of the successor are primed.

    Args:
        combination: whose attributes are read.
        here: int64 [B], location.
        mode: int64 [B].
        there: int64 [B], the successor's location.
        mode_there: int64 [B], the successor's mode.
    """
    return {
        MODE_VARIABLE: Column.of(mode),
        f"{MODE_VARIABLE}'": Column.of(mode_there),
        **step_scope(combination.space, combination.environment.attributes, here, there),
    }
