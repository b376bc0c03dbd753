"""Compute how likely an observation is under many hypotheses about a program's parameters, without a model.

A likelihood is a product of factors, at least one for each process, and a factor varies only along the
axes of the parameters that it reads. So a result is a tuple of arrays of logarithms, one for each set of
axes, which broadcast to the hypotheses; their sum is the log-likelihood, and -inf means impossible.

Under a hypothesis under which a guard, a probability or a value is undefined, or a probability is not in
[0, 1], the observation is impossible by it: such a program has no model.

Observations that are late or lost are not treated here: what lies between two known states is the matter
of a belief over states.

Axes: V variables, Y strengths of noise; [..] broadcasts to the hypotheses.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property, reduce
from typing import TypeAlias

import numpy as np

from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.program.expressions import variables
from merap.program.form import Command, InitialValues, Process, Program, Update
from merap.program.hypotheses import Hypotheses, PointEvaluator
from merap.program.initial_states import count_initial_states
from merap.program.names import suggestion
from merap.program.outcome_likelihood import likelihood, outcome_likelihood
from merap.program.parameters import parameters

# Logarithms of factors [..]; no two have the same shape.
Factors: TypeAlias = tuple[Floats, ...]
# The processes that take part in an action, and which of their commands may be meant.
_Parts: TypeAlias = tuple[tuple[Process, tuple[Command, ...]], ...]
_YES, _ONE, _ZERO = np.array(True), np.array(1.0), np.array(0.0)


class Evidence:
    """The likelihood of observations under every hypothesis.

    States are int64 [V] in the order of the program's variables, as valuations of an MDP are; false and
    true count as 0 and 1.

    Args:
        program: with unique actions and open parameters.
        hypotheses: values of all its parameters.

    Raises:
        InputError: a parameter has no value.
    """

    def __init__(self, program: Program, hypotheses: Hypotheses) -> None:
        self.program, self.hypotheses = program, hypotheses
        truths = frozenset(one.name for one in program.variables if one.kind == "bool")
        self._at = PointEvaluator(hypotheses, truths)
        self._names = tuple(one.name for one in program.variables)
        self._open_ranges = [
            one
            for one in program.variables
            if any(True for _ in (*variables(one.least), *variables(one.greatest)))
        ]
        self._parts = {action: _parts(program, action) for action in program.actions}
        _require_values(program, hypotheses)

    def start(self, state: Ints) -> Factors:
        """Return the likelihood that an episode starts in a state.

        Raises:
            ModelError: initial states are given by a condition, and are too many to count.
        """
        known = self._known(state)
        if self.program.initial_predicate is not None:
            holds = self._at.truth(self.program.initial_predicate, known)
            return _logs([holds / np.maximum(self._initial_states, 1)])
        return _logs([*self._within(known), *(self._started(one, known) for one in self.program.processes)])

    @cached_property
    def _initial_states(self) -> Ints:
        return count_initial_states(self.program, self.hypotheses)

    def presence(self, state: Ints) -> Factors:
        """Return the likelihood that a system can be in a state: the ranges of variables may be open."""
        return _logs(self._within(self._known(state)))

    def enabled(self, state: Ints, actions: Collection[str]) -> Factors:
        """Return the likelihood that exactly some actions are enabled in a state.

        Raises:
            InputError: there is no such action.
        """
        for name in actions:
            self._parts_of(name)
        known, factors = self._known(state), list[Floats]()
        for name, parts in self._parts.items():
            open_ = [self._any_enabled(commands, known) for _, commands in parts]
            if name in actions:
                factors += [one.astype(np.float64) for one in open_]
            else:
                closed = reduce(np.logical_or, (~one for one in open_), np.array(False))
                factors.append(closed.astype(np.float64))
        return _logs(factors)

    def step(self, state: Ints, action: str, target: Ints) -> Factors:
        """Return the likelihood that an action leads from a state to a target.

        Where more than one choice of commands is enabled, they are equally likely.

        Raises:
            InputError: there is no such action.
        """
        before, after = self._known(state), self._known(target)
        parts = self._parts_of(action)
        stepping = {process.name for process, _ in parts}
        kept = (
            one.name
            for process in self.program.processes
            if process.name not in stepping
            for one in process.variables
        )
        if any(before[name] != after[name] for name in kept):
            return _logs([_ZERO])
        factors = [self._stepped(process, commands, before, after) for process, commands in parts]
        return _logs([*self._within(after), *factors])

    def label(self, name: str, state: Ints, holds: bool) -> Factors:
        """Return the likelihood that a label, such as the end of an episode, holds in a state or not.

        Raises:
            InputError: there is no such label.
        """
        if name not in self.program.labels:
            raise InputError(_unknown(self.program, "label", name, self.program.labels))
        value, defined = self._at.value(self.program.labels[name], self._known(state))
        return _logs([(defined & (value == holds)).astype(np.float64)])

    def reward(
        self, structure: str, state: Ints, action: str, target: Ints, reward: float, noises: Floats
    ) -> Floats:
        """Return the log-density of the reward of a step, but for a constant.

        Args:
            structure: the name of the rewards.
            state: before the step.
            action: that was taken.
            target: the state after the step.
            reward: as received, noise included.
            noises: float64 [Y], standard deviations of Gaussian noise, above 0; one if it is known.

        Returns:
            float64 [.., Y].

        Raises:
            InputError: there is no such action, or there are no rewards of this name.
        """
        if structure not in self.program.rewards:
            raise InputError(_unknown(self.program, "reward structure", structure, self.program.rewards))
        self._parts_of(action)
        expected, defined = self._expected(structure, action, self._known(state), self._known(target))
        deviation = (reward - expected[..., np.newaxis]) / noises
        density = -0.5 * deviation**2 - np.log(noises)
        return np.where(defined[..., np.newaxis], density, -np.inf)

    def _expected(
        self, structure: str, action: str, before: Mapping[str, int], after: Mapping[str, int]
    ) -> tuple[Floats, Bools]:
        rewards = self.program.rewards[structure]
        known = {**before, **{f"{name}'": value for name, value in after.items()}}
        earned, defined, open_ = _ZERO, _YES, _YES
        for rule in rewards.rules:
            if rule.actions and action not in rule.actions:
                continue
            holds, is_known = self._at.value(rule.guard, known)
            if not np.any(open_ & (holds | ~is_known)):
                continue
            value, is_number = self._at.value(rule.value, known)
            matches = open_ & holds
            defined = defined & np.where(open_, is_known & (is_number | ~holds), True)
            earned = earned + np.where(matches & is_number, value, 0.0)
            if rewards.first_match:
                open_ = open_ & ~holds
        return earned, defined

    def _known(self, state: Ints) -> dict[str, int]:
        return dict(zip(self._names, np.asarray(state).tolist(), strict=True))

    def _parts_of(self, action: str) -> _Parts:
        if action not in self._parts:
            raise InputError(_unknown(self.program, "action", action, self._parts))
        return self._parts[action]

    def _within(self, known: Mapping[str, int]) -> Iterator[Floats]:
        """Yield 1 where open ranges hold the values of variables."""
        for one in self._open_ranges:
            low, low_defined = self._at.whole(one.least, {})
            high, high_defined = self._at.whole(one.greatest, {})
            inside = low_defined & high_defined & (low <= known[one.name]) & (known[one.name] <= high)
            yield inside.astype(np.float64)

    def _started(self, process: Process, known: Mapping[str, int]) -> Floats:
        return sum((self._start(one, known) for one in process.initial), _ZERO)

    def _start(self, start: InitialValues, known: Mapping[str, int]) -> Floats:
        return outcome_likelihood(
            self._at, Update(start.probability, start.values), {}, {}, known, start.values
        )

    def _any_enabled(self, commands: Iterable[Command], known: Mapping[str, int]) -> Bools:
        return reduce(np.logical_or, (self._at.truth(one.guard, known) for one in commands), np.array(False))

    def _stepped(
        self,
        process: Process,
        commands: Iterable[Command],
        before: Mapping[str, int],
        after: Mapping[str, int],
    ) -> Floats:
        """Return the likelihood of what a process becomes."""
        enabled = [(one, holds) for one in commands if (holds := self._at.truth(one.guard, before)).any()]
        target = {one.name: after[one.name] for one in process.variables}
        likelihoods = [
            np.where(holds, likelihood(self._at, one, before, target), 0.0) for one, holds in enabled
        ]
        if len(enabled) <= 1:
            return likelihoods[0] if enabled else _ZERO
        total: Floats = sum(likelihoods, _ZERO)
        return total / np.maximum(sum(holds.astype(np.int64) for _, holds in enabled), 1)


def joint(factors: Factors, shape: tuple[int, ...]) -> Floats:
    """Return the log-likelihood under every hypothesis: float64 of the shape of the hypotheses."""
    return np.array(np.broadcast_to(sum(factors, _ZERO), shape))


def _logs(factors: Iterable[Floats]) -> Factors:
    """Return logarithms, those of one shape added up."""
    products: dict[tuple[int, ...], Floats] = {}
    for factor in factors:
        products[factor.shape] = products.get(factor.shape, _ONE) * factor
    with np.errstate(divide="ignore"):
        return tuple(np.log(product) for product in products.values())


def _parts(program: Program, action: str) -> _Parts:
    return tuple(
        (process, tuple(one for one in process.commands if one.action == action))
        for process in program.processes
        if action in process.actions
    )


def _require_values(program: Program, hypotheses: Hypotheses) -> None:
    """Refuse hypotheses that leave a parameter open."""
    missing = sorted(parameters(program) - hypotheses.keys())
    if missing:
        raise InputError(f"{program.name}: the hypotheses give no value to {', '.join(missing)}")


def _unknown(program: Program, kind: str, name: str, known: Collection[str]) -> str:
    return f"{program.name}: there is no {kind} {name!r}{suggestion(name, known)}"
