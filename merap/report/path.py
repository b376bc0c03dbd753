"""The way a policy takes through the locations: likeliest, or as it was recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, TypeAlias

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.synthesis import synthesise_pair
from merap.errors import ModelError
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, FLAG_VARIABLE, MODE_VARIABLE

Ending: TypeAlias = Literal["completed", "ended", "loop", "open"]

_NOTES: dict[Ending, str] = {
    "completed": "(done)",
    "ended": "(ended)",
    "loop": "(loop)",
    "open": "(not completed)",
}


@dataclass(frozen=True)
class RoutePath:
    """T steps through the locations of a case.

    Attributes:
        locations: T + 1 indices of locations.
        names: T + 1 names of these locations.
        actions: T names of actions.
        modes: T + 1 names of modes; empty where they were not recorded.
        ending: the task was completed; or it ended where no goal is; or it would go round for ever; or
            nothing of that is known.
        label: its name in a legend.
    """

    locations: tuple[int, ...]
    names: tuple[str, ...]
    actions: tuple[str, ...]
    modes: tuple[str, ...]
    ending: Ending
    label: str = "path"

    @property
    def completed(self) -> bool:
        """Whether the task was completed."""
        return self.ending == "completed"

    @property
    def text(self) -> str:
        """One line, such as `S [scan] -east-> hall [east x2] -east-> G3 (stop)`.

        Arrows move, brackets stay (an innate action, or a move that was blocked or failed), the
        parentheses at the end hold the action that completed the task, or how else it ended.
        """
        return " ".join([self.names[0], *self._steps_as_text()])

    def _steps_as_text(self) -> Iterator[str]:
        moves = zip(self.actions, self.names, self.names[1:], strict=False)
        steps = [f"-{action}-> {there}" if here != there else f"[{action}]" for action, here, there in moves]
        closing = _NOTES[self.ending]
        if self.ending in {"completed", "ended"} and steps and steps[-1].startswith("["):
            closing = f"({steps.pop()[1:-1]})"
        for step, repeats in groupby(steps):
            count = sum(1 for _ in repeats)
            yield step if count == 1 else f"{step[:-1]} x{count}]"
        yield closing


def most_likely_path(
    mdp: TabularMDP, combination: DeclaredCombination, policy: Floats, horizon: int, label: str = "path"
) -> RoutePath:
    """Follow a policy from the likeliest start: always the likeliest action and outcome.

    An outcome that stays in the state is followed only if there is no other: a stationary
    policy then simply tries again.

    Args:
        mdp: the whole model (p, q, done) of the combination, or its model on the canonical
            index p * Q + q with the completed state last.
        combination: whose locations and modes these are.
        policy: float [S, A], or float [T, S, A] by time t.
        horizon: T, the most steps to follow.
        label: for the legend.

    Raises:
        ModelError: the policy has another shape.
    """
    _check_shape(mdp, policy, horizon)
    states, actions, ending = _follow(mdp, policy, horizon)
    locations, modes = _location_and_mode(mdp, combination, np.array(states))
    if ending == "completed" and actions and FLAG_VARIABLE not in mdp.variable_names:
        # The completed state of the canonical index does not tell where the task ended.
        locations[-1], modes[-1] = _where_completed(mdp, combination, states[-2], actions[-1])
    return RoutePath(
        locations=tuple(locations.tolist()),
        names=tuple(combination.space.locations[location] for location in locations),
        actions=tuple(mdp.action_names[action] for action in actions),
        modes=tuple(combination.modes[mode] for mode in modes),
        ending=_judged(ending, combination, int(locations[-1])),
        label=label,
    )


def _judged(ending: Ending, combination: DeclaredCombination, last: int) -> Ending:
    """Return `ended` for a task with a goal that came to an end elsewhere, else the same."""
    goal = combination.objective.goal
    return "ended" if ending == "completed" and goal.any() and not goal[last] else ending


def _check_shape(mdp: TabularMDP, policy: Floats, horizon: int) -> None:
    expected: tuple[int, ...] = (mdp.num_states, mdp.num_actions)
    if policy.ndim == 3:
        expected = (horizon, *expected)
    if policy.shape != expected:
        raise ModelError(f"the policy has shape {policy.shape}, not {expected}")


def _follow(mdp: TabularMDP, policy: Floats, horizon: int) -> tuple[list[int], list[int], Ending]:
    """Walk: return states [T + 1], actions [T], and how it ends."""
    complete = mdp.labels[COMPLETE_LABEL]
    states, actions = [int(mdp.initial.argmax())], list[int]()
    while not complete[states[-1]]:
        if len(actions) == horizon:
            return states, actions, "open"
        rows = policy[len(actions)] if policy.ndim == 3 else policy
        here = states[-1]
        actions.append(int(np.where(mdp.enabled[here], rows[here], -1).argmax()))
        states.append(_likeliest_successor(mdp, here, actions[-1]))
        if policy.ndim == 2 and states[-1] in states[:-1]:
            return states, actions, "loop"
    return states, actions, "completed"


def _likeliest_successor(mdp: TabularMDP, state: int, action: int) -> int:
    targets, prob = _successors(mdp, state, action)
    leaving = targets != state
    return int(targets[np.where(leaving, prob, 0).argmax()]) if leaving.any() else state


def _successors(mdp: TabularMDP, state: int, action: int) -> tuple[Ints, Floats]:
    """Return the successors of a choice and their probabilities."""
    first, end = mdp.state_to_choice[state : state + 2]
    choice = first + int(np.flatnonzero(mdp.choice_action[first:end] == action)[0])
    branches = slice(*mdp.choice_to_branch[choice : choice + 2])
    return mdp.branch_target[branches], mdp.branch_prob[branches]


def _location_and_mode(mdp: TabularMDP, combination: DeclaredCombination, states: Ints) -> tuple[Ints, Ints]:
    """Return the location and the mode of each state, int64 [T + 1]; of no meaning for a folded state."""
    space = combination.space
    columns = [mdp.variable_names.index(name) for name in space.variable_names]
    variables = mdp.valuations[states][:, columns]
    locations = variables[:, 0] if space.shape is None else variables @ np.array([space.shape[1], 1])
    modes = np.zeros_like(locations)
    if MODE_VARIABLE in mdp.variable_names:
        modes = mdp.valuations[states, mdp.variable_names.index(MODE_VARIABLE)]
    return np.array(locations), np.array(modes)


def _where_completed(
    mdp: TabularMDP, combination: DeclaredCombination, state: int, action: int
) -> tuple[int, int]:
    """Return location and mode where a step into the folded completed state leads.

    Without objective the same choice has the same successors, but for those that were folded.
    """
    targets, prob = _successors(synthesise_pair(combination), state, action)
    folded = ~np.isin(targets, _successors(mdp, state, action)[0])
    location, mode = divmod(int(targets[np.where(folded, prob, 0).argmax()]), len(combination.modes))
    return location, mode
