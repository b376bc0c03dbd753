"""Build the MDP of a program without a model checker.

Three ways give the same states. Breadth-first search takes a whole frontier at a time: it is fast where
frontiers are wide. Where they are narrow and there are not too many valuations, the steps of all of them are
computed at once, and those that can be reached are kept. A list of states from elsewhere is checked.

Axes: N states, B branches, V variables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from merap.errors import InputError, ModelError
from merap.mdp.assembly import sum_by
from merap.mdp.graph import reachable_along
from merap.mdp.model import Bools, Floats, Ints
from merap.program.expressions import ONE, Constant, evaluate_where_defined, number, render
from merap.program.form import InitialValues, Program, whole
from merap.program.states import Encoding, States
from merap.program.steps import CommandChoice, StepBranches, Stepper

# A frontier costs as much as so many states, whatever its size.
FRONTIER = 3000
# All valuations are computed at once only if they are not more than these.
MAX_PRODUCT = 10_000_000
MAX_STATES = 20_000_000
# A set of visited states is a mask over all valuations if those are not more than these.
MAX_MASK = 200_000_000
# States whose steps are computed at once.
CHUNK = 1 << 16
# A table over all valuations is worth its while if it is not longer by more than this factor.
DENSE = 4


@dataclass(frozen=True, eq=False)
class Exploration:
    """The reachable states of a program and their steps.

    Attributes:
        encoding: of the states.
        codes: int64 [N], rising.
        initial: float64 [N], a distribution.
        branches: of these states, sources and targets as codes.
        choices: what the branches' choices are.
    """

    encoding: Encoding
    codes: Ints
    initial: Floats
    branches: StepBranches
    choices: tuple[CommandChoice, ...]

    def place(self, codes: Ints) -> Ints:
        """int64 [M], where some of the states stand among all."""
        if len(self.codes) == self.encoding.size:
            return codes
        if self.encoding.size > DENSE * len(codes):
            return np.searchsorted(self.codes, codes)
        return self._places[codes]

    @cached_property
    def _places(self) -> Ints:
        """int64 [all valuations]."""
        places = np.full(self.encoding.size, -1)
        places[self.codes] = np.arange(len(self.codes))
        return places


def explore(program: Program, states: Ints | None = None) -> Exploration:
    """Find the reachable states of a program and their steps.

    Args:
        program: without open parameters.
        states: int64 [N, V], what another route has found to be reachable, in any order; None: search.

    Raises:
        ModelError: a reachable state in which a guard, a probability or a new value is undefined,
            probabilities do not sum to 1, or a variable leaves its range; there is no initial state, or
            there are too many states; the given states are not those that are reachable.
    """
    stepper = Stepper(program)
    starts, weights = initial_states(program, stepper.encoding)
    if states is not None:
        codes, branches = _given(stepper, states, starts)
    else:
        codes, branches = _search(stepper, starts)
    stepper.require_sound(codes)
    initial = np.zeros(len(codes))
    initial[np.searchsorted(codes, starts)] = weights
    return Exploration(stepper.encoding, codes, initial, branches, tuple(stepper.choices))


def initial_states(program: Program, encoding: Encoding) -> tuple[Ints, Floats]:
    """Return the codes of the initial states, rising, and their probabilities.

    Raises:
        ModelError: there is none, or too many to enumerate.
    """
    if program.initial_predicate is not None:
        return _where_it_holds(program, encoding)
    codes, weights = np.zeros(1, dtype=np.int64), np.ones(1)
    for process in program.processes:
        own = np.array([_code(encoding, start) for start in process.initial], dtype=np.int64)
        chances = np.array([_probability(start) for start in process.initial])
        codes = (codes[:, None] + own).ravel()
        weights = (weights[:, None] * chances).ravel()
    distinct, inverse = np.unique(codes[weights > 0], return_inverse=True)
    return distinct, sum_by(inverse, weights[weights > 0], len(distinct))


def started_at(program: Program, values: Mapping[str, int]) -> Program:
    """Return the program with one initial state.

    Args:
        program: any.
        values: of all its variables; false counts as 0, named values by their numbers.
    """
    return replace(
        program,
        processes=tuple(
            replace(
                process,
                initial=(
                    InitialValues(
                        ONE,
                        {one.name: number(values[one.name]) for one in process.variables},
                    ),
                ),
            )
            for process in program.processes
        ),
        initial_predicate=None,
    )


def _code(encoding: Encoding, start: InitialValues) -> int:
    code = 0
    for name, value in start.values.items():
        variable, number = encoding.by_name[name], whole(value, f"the initial value of {name}")
        if not variable.low <= number <= variable.high:
            raise InputError(
                f"the initial value of {name} is {number}, allowed is {variable.low}..{variable.high}"
            )
        code += (number - variable.low) * encoding.strides[name]
    return code


def _probability(start: InitialValues) -> float:
    if not isinstance(start.probability, Constant) or not 0 <= start.probability.value <= 1:
        raise InputError(f"the probability of an initial value is {render(start.probability)}, not in [0, 1]")
    return float(start.probability.value)


def _where_it_holds(program: Program, encoding: Encoding) -> tuple[Ints, Floats]:
    predicate = program.initial_predicate
    assert predicate is not None
    if encoding.size > MAX_PRODUCT:
        raise ModelError(
            f"{program.name}: initial states are given by a condition, and the variables have "
            f"{float(encoding.size):.3g} joint values, at most {MAX_PRODUCT} can be tried"
        )
    codes = np.arange(encoding.size)
    holds, defined = evaluate_where_defined(predicate, States(encoding, codes))
    found = codes[np.broadcast_to(holds & defined, codes.shape)]
    if not len(found):
        raise ModelError(f"{program.name}: no state is initial")
    return found, np.full(len(found), 1 / len(found))


def _search(stepper: Stepper, starts: Ints) -> tuple[Ints, StepBranches]:
    """Breadth-first, as long as that is not more work than to try all valuations."""
    size = stepper.encoding.size
    seen = _Seen(size)
    found, parts, work = [starts], [], 0
    frontier = seen.add(starts)
    while len(frontier):
        work += FRONTIER + len(frontier)
        if work > size and size <= MAX_PRODUCT:
            return _from_all(stepper, starts)
        branches = stepper.branches(frontier)
        stepper.require_sound(frontier)
        parts.append(branches)
        frontier = seen.add(branches.target)
        found.append(frontier)
        if seen.count > MAX_STATES:
            raise ModelError(f"{stepper.program.name}: there are more than {MAX_STATES} states")
    return np.sort(np.concatenate(found)), joined(parts)


def _from_all(stepper: Stepper, starts: Ints) -> tuple[Ints, StepBranches]:
    """Compute the steps of all valuations, and keep those that can be reached."""
    stepper.faults.clear()
    size = stepper.encoding.size
    branches = _in_chunks(stepper, np.arange(size))
    roots = np.zeros(size, dtype=np.bool_)
    roots[starts] = True
    reached = reachable_along(branches.source, branches.target, roots)
    kept = reached[branches.source]
    return np.flatnonzero(reached), _some(branches, kept)


def _given(stepper: Stepper, states: Ints, starts: Ints) -> tuple[Ints, StepBranches]:
    """Compute the steps of states that another route has found."""
    encoding = stepper.encoding
    lows = np.array([variable.low for variable in encoding.variables])
    highs = np.array([variable.high for variable in encoding.variables])
    if np.any((states < lows) | (states > highs)):
        raise ModelError(f"{stepper.program.name}: a given state has a value out of its variable's range")
    codes = _distinct(encoding.codes(states))
    if len(codes) < len(states):
        raise ModelError(f"{stepper.program.name}: a given state is given twice")
    branches = _in_chunks(stepper, codes)
    for needed, kind in ((starts, "initial"), (branches.target, "reachable")):
        place = np.minimum(np.searchsorted(codes, needed), len(codes) - 1)
        missing = needed[codes[place] != needed]
        if len(missing):
            state = encoding.describe(int(missing.min()))
            raise ModelError(f"{stepper.program.name}: state {state} is {kind}, but is not given")
    roots = np.isin(codes, starts)
    places = np.searchsorted(codes, branches.source), np.searchsorted(codes, branches.target)
    beyond = np.flatnonzero(~reachable_along(*places, roots))
    if len(beyond):
        state = encoding.describe(int(codes[beyond[0]]))
        raise ModelError(f"{stepper.program.name}: state {state} is given, but can't be reached")
    return codes, branches


def _in_chunks(stepper: Stepper, codes: Ints) -> StepBranches:
    """Compute the steps of many states, so many at a time as processors hold near."""
    return joined([stepper.branches(codes[first : first + CHUNK]) for first in range(0, len(codes), CHUNK)])


def _distinct(codes: Ints) -> Ints:
    """Return distinct codes, rising; `np.unique` hashes, which takes ten times as long for many."""
    ordered = np.sort(codes)
    distinct: Ints = ordered[np.diff(ordered, prepend=-1) != 0]
    return distinct


class _Seen:
    """A growing set of codes: a mask, or sorted arrays that are merged as they grow."""

    def __init__(self, size: int) -> None:
        self._mask = np.zeros(size, dtype=np.bool_) if size <= MAX_MASK else None
        self._sorted: list[Ints] = []
        self.count = 0

    def add(self, codes: Ints) -> Ints:
        """Add codes; return those that are new, rising."""
        new = _distinct(codes[~self._holds(codes)])
        self.count += len(new)
        if self._mask is not None:
            self._mask[new] = True
        elif len(new):
            self._sorted.append(new)
            while len(self._sorted) > 1 and len(self._sorted[-2]) < 2 * len(self._sorted[-1]):
                last = self._sorted.pop()
                self._sorted[-1] = np.sort(np.concatenate([self._sorted[-1], last]))
        return new

    def _holds(self, codes: Ints) -> Bools:
        if self._mask is not None:
            return self._mask[codes]
        held = np.zeros(len(codes), dtype=np.bool_)
        for part in self._sorted:
            place = np.minimum(np.searchsorted(part, codes), len(part) - 1)
            held |= part[place] == codes
        return held


def joined(parts: Sequence[StepBranches]) -> StepBranches:
    """Return all branches of several parts."""
    columns = zip(*((one.source, one.choice, one.target, one.prob) for one in parts), strict=True)
    return StepBranches(*(np.concatenate(column) for column in columns))


def _some(branches: StepBranches, kept: Bools) -> StepBranches:
    return StepBranches(
        branches.source[kept], branches.choice[kept], branches.target[kept], branches.prob[kept]
    )
