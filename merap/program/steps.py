"""Compute the steps of many states of a program at once.

Axes: N states, n states in which a choice is enabled, B branches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.model import ROW_SUM_TOLERANCE, Bools, Floats, Ints
from merap.program.expressions import Column, Expression, Scope, evaluate_where_defined, evaluate_whole
from merap.program.form import Command, Draw, Process, Program
from merap.program.states import Encoding, States, StepColumns


@dataclass(frozen=True, order=True)
class CommandChoice:
    """Commands that are taken together.

    Attributes:
        action: their action; the name of the process where there is none.
        labelled: whether it is an action.
        positions: of each process that takes part, in order: the number of its command, from 1, among its
            commands of that action.
    """

    action: str
    labelled: bool
    positions: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class StepBranches:
    """Branches of some states; of a choice two may lead to one state.

    Attributes:
        source: int64 [B], codes.
        choice: int64 [B], numbers of choices.
        target: int64 [B], codes.
        prob: float64 [B], above 0.
    """

    source: Ints
    choice: Ints
    target: Ints
    prob: Floats


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong in some states, if they can be reached."""

    codes: Ints
    message: str


# Probability and change of the code, in the rows (int64 [n]) that it has a positive probability in.
_Part: TypeAlias = tuple[Ints, Floats, Ints]


@dataclass(eq=False)
class Stepper:
    """Computes the steps of a program's states, and collects what is wrong with them.

    Attributes:
        program: without open parameters.
        choices: those that were enabled somewhere, by the number that branches have.
        faults: met so far.
    """

    program: Program
    choices: dict[CommandChoice, int] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.encoding = Encoding(self.program.variables)
        self._by_action: dict[str, list[list[Command]]] = {action: [] for action in self.program.actions}
        self._alone: list[tuple[Process, Command, int]] = []
        for process in self.program.processes:
            for action in sorted(process.actions):
                self._by_action[action].append([one for one in process.commands if one.action == action])
            alone = [command for command in process.commands if command.action is None]
            self._alone += [(process, command, place) for place, command in enumerate(alone, start=1)]

    def branches(self, codes: Ints) -> StepBranches:
        """Return the branches of some states, each given once; faults are appended to `faults`."""
        parts = list(self._parts(States(self.encoding, codes)))
        if not parts:
            nothing = np.zeros(0, dtype=np.int64)
            return StepBranches(nothing, nothing, nothing, np.zeros(0))
        return StepBranches(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def require_sound(self, reached: Ints) -> None:
        """Refuse the program if something is wrong in a state that can be reached.

        Args:
            reached: int64 [N], codes, rising.

        Raises:
            ModelError: names program, state and command.
        """
        for fault in self.faults:
            found = np.intersect1d(fault.codes, reached)
            if len(found):
                state = self.encoding.describe(int(found[0]))
                raise ModelError(f"{self.program.name}: {fault.message} in state {state}")

    def _parts(self, states: States) -> Iterator[tuple[Ints, Ints, Ints, Floats]]:
        for process, command, place in self._alone:
            choice = CommandChoice(process.name, False, (place,))
            yield from self._joint(states, self._enabled(command, states), choice, [command])
        for action, members in self._by_action.items():
            enabled = [[self._enabled(command, states) for command in commands] for commands in members]
            for rows, places in _combinations(enabled, np.arange(len(states.codes))):
                chosen = [commands[place] for commands, place in zip(members, places, strict=True)]
                choice = CommandChoice(action, True, tuple(place + 1 for place in places))
                yield from self._joint(states, rows, choice, chosen)

    def _enabled(self, command: Command, states: States) -> Ints:
        """Return the rows in which a command's guard holds."""
        values, defined = _spread(evaluate_where_defined(command.guard, states), states)
        self._fault(states, ~defined, f"the guard of {command.place} is undefined")
        return np.flatnonzero(values & defined)

    def _joint(
        self, states: States, rows: Ints, choice: CommandChoice, chosen: Sequence[Command]
    ) -> Iterator[tuple[Ints, Ints, Ints, Floats]]:
        """Yield every joint outcome of commands that are taken together."""
        if not len(rows):
            return
        number = self.choices.setdefault(choice, len(self.choices))
        here = states.some(rows)
        joint: list[_Part] = [(np.arange(len(rows)), np.ones(len(rows)), np.zeros(len(rows), dtype=np.int64))]
        for command in chosen:
            own = list(self._drawn(command, command.draws, here, {}))
            joint = [_times(left, right, len(rows)) for left in joint for right in own]
        for places, prob, change in joint:
            source = here.codes[places]
            yield source, np.full(len(places), number), source + change, prob

    def _drawn(
        self, command: Command, draws: Sequence[Draw], states: States, after: Mapping[str, Ints]
    ) -> Iterator[_Part]:
        """Yield the joint outcomes of the draws that remain, after those that have given `after`."""
        if not draws:
            count = len(states.codes)
            yield np.arange(count), np.ones(count), self._change(states, after)
            return
        total = np.zeros(len(states.codes))
        for outcome in draws[0]:
            prob = self._probability(command, outcome.probability, _scope(states, after), states)
            total += prob
            rows = np.flatnonzero(prob > 0)
            if len(rows):
                here = states.some(rows)
                known = {name: values[rows] for name, values in after.items()}
                scope = _scope(here, known)
                new = {
                    name: self._assigned(command, name, value, scope, here)
                    for name, value in outcome.assignments.items()
                }
                for places, rest, change in self._drawn(command, draws[1:], here, {**known, **new}):
                    yield rows[places], prob[rows][places] * rest, change
        off = np.abs(total - 1) > ROW_SUM_TOLERANCE
        if off.any():
            self._fault(
                states, off, f"the probabilities of {command.place} sum to {total[off][0]:.12g}, not 1,"
            )

    def _probability(self, command: Command, value: Expression, scope: Scope, states: States) -> Floats:
        prob, defined = _spread(evaluate_where_defined(value, scope), states)
        self._fault(states, ~defined, f"a probability of {command.place} is undefined")
        outside = defined & ((prob < 0) | (prob > 1))
        if outside.any():
            self._fault(states, outside, f"{command.place} has a probability of {prob[outside][0]:.12g}")
        return np.where(defined & ~outside, prob, 0.0)

    def _assigned(self, command: Command, name: str, value: Expression, scope: Scope, states: States) -> Ints:
        low, high = self.encoding.by_name[name].low, self.encoding.by_name[name].high
        values, defined = _spread(evaluate_whole(value, scope), states)
        self._fault(states, ~defined, f"{command.place} makes {name} no whole number")
        outside = defined & ((values < low) | (values > high))
        if outside.any():
            message = f"{command.place} makes {name} {values[outside][0]}, allowed is {low}..{high},"
            self._fault(states, outside, message)
        return np.where(defined & ~outside, values, low)

    def _change(self, states: States, after: Mapping[str, Ints]) -> Ints:
        """int64 [N], how far the codes of the states are from those of their successors."""
        change = np.zeros(len(states.codes), dtype=np.int64)
        for name, values in after.items():
            shift = values - self.encoding.by_name[name].low - states.digits(name)
            change += shift * self.encoding.strides[name]
        return change

    def _fault(self, states: States, where: Bools, message: str) -> None:
        if where.any():
            self.faults.append(Fault(states.codes[where], message))


def _scope(states: States, after: Mapping[str, Ints]) -> Scope:
    kinds = states.encoding.by_name
    return StepColumns(
        states,
        {
            name: Column.of(values.astype(np.bool_) if kinds[name].kind == "bool" else values)
            for name, values in after.items()
        },
    )


def _spread(parts: tuple[npt.NDArray[Any], Bools], states: States) -> tuple[npt.NDArray[Any], Bools]:
    """Broadcast values, and where they are defined, to all states."""
    values, defined = (np.broadcast_to(part, states.codes.shape) for part in parts)
    return values, defined


def _combinations(guards: list[list[Ints]], rows: Ints) -> Iterator[tuple[Ints, tuple[int, ...]]]:
    """Choose a command of each process in every way that is enabled somewhere: rows, and which."""
    if not guards:
        yield rows, ()
        return
    for place, where in enumerate(guards[0]):
        both = where if len(rows) == 0 or len(where) == 0 else np.intersect1d(rows, where, assume_unique=True)
        if len(both) and len(rows):
            for found, rest in _combinations(guards[1:], both):
                yield found, (place, *rest)


def _times(left: _Part, right: _Part, count: int) -> _Part:
    """Two independent outcomes at once, in the rows that both have."""
    if len(left[0]) == len(right[0]) == count:
        return left[0], left[1] * right[1], left[2] + right[2]
    rows, one, other = np.intersect1d(left[0], right[0], assume_unique=True, return_indices=True)
    return rows, left[1][one] * right[1][other], left[2][one] + right[2][other]
