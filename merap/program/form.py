"""Define programs: what a case and a PRISM text both become.

A program is a set of processes that step together, as the modules of PRISM do. Each process owns
variables and has commands. An action is enabled where every process that knows it has a command of that
action whose guard holds; each of them draws its own outcome, and the probabilities multiply. A command
without an action is a step of its process alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    TRUE,
    Constant,
    Expression,
    Integers,
    Levels,
    number,
    variables,
)

ConcernName: TypeAlias = Literal["environment", "capability", "objective"]
Kind: TypeAlias = Literal["bool", "int", "named"]


@dataclass(frozen=True, repr=False)
class StateVariable(ShortRepr):
    """A variable with a finite domain of consecutive integers.

    Attributes:
        name: of the variable.
        least: its least value; constant in a closed program.
        greatest: its greatest value; likewise.
        kind: `bool` counts 0 and 1; `named` values are numbered from `low` on.
        values: the names of named values, else empty.
    """

    name: str
    least: Expression
    greatest: Expression
    kind: Kind = "int"
    values: tuple[str, ...] = ()

    @cached_property
    def low(self) -> int:
        """The least value, of a closed program."""
        return whole(self.least, f"the least value of {self.name}")

    @cached_property
    def high(self) -> int:
        """The greatest value, of a closed program."""
        return whole(self.greatest, f"the greatest value of {self.name}")

    @property
    def size(self) -> int:
        """The number of values."""
        return self.high - self.low + 1

    @cached_property
    def levels(self) -> Levels:
        """All values: false and true, or numbers."""
        return Levels((False, True)) if self.kind == "bool" else Integers(np.arange(self.low, self.high + 1))

    def text(self, value: int) -> str:
        """Return one of the values as it is written: a truth value, a name or a number."""
        if self.kind == "bool":
            return "true" if value else "false"
        return self.values[value - self.low] if self.kind == "named" else str(value)


def integer(name: str, low: int, high: int) -> StateVariable:
    """Return a variable with the values low..high."""
    return StateVariable(name, number(low), number(high))


def boolean(name: str) -> StateVariable:
    """Return a variable that is true or false."""
    return replace(integer(name, 0, 1), kind="bool")


def whole(expression: Expression, meaning: str) -> int:
    """Return the value of a constant expression; false counts as 0, true as 1.

    Raises:
        InputError: it is no whole number, or depends on a parameter.
    """
    if not isinstance(expression, Constant):
        open_names = ", ".join(sorted({variable.name for variable in variables(expression)}))
        raise InputError(f"{meaning} depends on {open_names}, which has no value")
    value = Fraction(expression.value)
    if value.denominator != 1:
        raise InputError(f"{meaning} is {value}, expected a whole number")
    return int(value)


@dataclass(frozen=True, repr=False)
class Update(ShortRepr):
    """One possible result of a draw.

    Attributes:
        probability: a number in [0, 1].
        assignments: variable -> new value, over the state before the step and, primed, over variables
            that earlier draws of the same command have assigned. What is not assigned keeps its value.
    """

    probability: Expression
    assignments: Mapping[str, Expression] = field(default_factory=dict)


Draw: TypeAlias = tuple[Update, ...]


@dataclass(frozen=True, repr=False)
class Command(ShortRepr):
    """A step that a process can take.

    Attributes:
        action: its name; None: the process steps alone.
        guard: over the state before the step: where the command is enabled.
        draws: made one after the other; a later one may depend on what an earlier one has given. The
            probabilities of a draw sum to 1 wherever the guard holds.
        place: what it is called in messages.
    """

    action: str | None
    guard: Expression
    draws: tuple[Draw, ...]
    place: str


@dataclass(frozen=True, repr=False)
class InitialValues(ShortRepr):
    """A joint initial value of the variables of a process, with its probability; both may read parameters."""

    probability: Expression
    values: Mapping[str, Expression]


@dataclass(frozen=True, repr=False)
class Process(ShortRepr):
    """A named group of variables with rules of change, owned by one concern.

    Attributes:
        name: of the process.
        concern: which concern owns it.
        variables: that only this process assigns.
        commands: in their order.
        initial: a distribution over joint initial values of its variables; processes are independent.
        meaning: a comment for text.
    """

    name: str
    concern: ConcernName
    variables: tuple[StateVariable, ...]
    commands: tuple[Command, ...]
    initial: tuple[InitialValues, ...]
    meaning: str = ""

    @cached_property
    def actions(self) -> frozenset[str]:
        """The actions it knows: where it has no enabled command, they are disabled."""
        return frozenset(command.action for command in self.commands if command.action is not None)


@dataclass(frozen=True, repr=False)
class RewardItem(ShortRepr):
    """A reward of steps.

    Attributes:
        value: over the state and, primed, the successor.
        guard: likewise: where it is earned.
        actions: names; `None` stands for a step without an action. Empty: every step.
    """

    value: Expression
    guard: Expression = TRUE
    actions: frozenset[str | None] = frozenset()


@dataclass(frozen=True, repr=False)
class RewardStructure(ShortRepr):
    """Rewards of one name.

    Attributes:
        rules: in their order.
        first_match: the first rule that matches counts; else all that match are added, as in PRISM.
        shift: the name of a constant: text has a second structure, `<name>_shifted`, in which every step
            earns so much more that none earns less than 0. None: there is no such structure.
    """

    rules: tuple[RewardItem, ...]
    first_match: bool = False
    shift: str | None = None


@dataclass(frozen=True, repr=False)
class Program(ShortRepr):
    """Processes that step together. Names that no process owns are parameters; a closed program has none.

    Attributes:
        name: for messages.
        processes: no two own a variable of one name.
        labels: name -> where it holds.
        rewards: name -> reward structure.
        initial_predicate: all states where it holds are initial, equally likely; None: the processes say
            where they begin.
        location: the variables that hold the location together: row and column, or one number.
        definitions: names that text uses for parts of the program's expressions.
        monitors: the variables that the objective owns: they watch the steps, and move nothing.
        flag: the monitor that only tells whether a step has completed the task; None: there is none.
    """

    name: str
    processes: tuple[Process, ...]
    labels: Mapping[str, Expression] = field(default_factory=dict)
    rewards: Mapping[str, RewardStructure] = field(default_factory=dict)
    initial_predicate: Expression | None = None
    location: tuple[str, ...] = ()
    definitions: Mapping[str, Expression] = field(default_factory=dict)
    monitors: frozenset[str] = frozenset()
    flag: str | None = None

    @cached_property
    def variables(self) -> tuple[StateVariable, ...]:
        """All variables, in the order of the processes."""
        return tuple(variable for process in self.processes for variable in process.variables)

    @cached_property
    def moving(self) -> tuple[Process, ...]:
        """The processes that are more than monitors: environment and capability alone, which nothing ends."""
        return tuple(
            process
            for process in self.processes
            if process.concern != "objective"
            or any(variable.name not in self.monitors for variable in process.variables)
        )

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """The names of actions, in the order in which they first occur."""
        return tuple(
            dict.fromkeys(
                command.action
                for process in self.processes
                for command in process.commands
                if command.action is not None
            )
        )
