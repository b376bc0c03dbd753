"""Write a program as PRISM text that Storm and PRISM-games read alike.

One module for each process, in the order of the program; the same program gives the same bytes. Commands that
draw several times get their joint outcomes. Every decision is one on whole numbers, and a probability is
one of the fractions that it can be, so that no engine adds or subtracts probabilities.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from merap.prism.engine_form import joined
from merap.prism.engine_text import EngineText, text_of
from merap.prism.joint_outcomes import joint_outcomes
from merap.prism.lines import CommandLine, Formula, LabelLine, VariableLine
from merap.prism.reward_text import rewards_text, wrapped
from merap.prism.templates import fill_in
from merap.prism.text_names import text_names, with_text_names
from merap.program.expressions import FALSE, ZERO, Constant, Expression, Operation, Variable, negation
from merap.program.form import Command, InitialValues, Process, Program, StateVariable, Update, whole

KEY_WIDTH = 10


@dataclass(frozen=True)
class ModuleText:
    """A module, and the formulas that it needs; the comment says whose it is."""

    name: str
    comment: str
    formulas: tuple[Formula, ...]
    variables: tuple[VariableLine, ...]
    commands: tuple[CommandLine, ...]


def render_program(program: Program, header: tuple[str, ...] = ()) -> str:
    """Return the PRISM text of a closed program.

    Args:
        program: without open parameters.
        header: lines of comment at the top.

    Raises:
        InputError: an expression can't be written exactly; a command, or what a reward reads of the
            successor, has more than 256 joint outcomes.
    """
    names = text_names(program)
    program = with_text_names(program, names)
    writer = ProgramWriter(program)
    text = writer.text
    shared = [process for process in program.processes if not process.commands]
    sections = {
        "shared": [line for process in shared for line in writer.lines(process)],
        "processes": [writer.module(process) for process in program.processes if process.commands],
        "labels": writer.labels(),
        "rewards": rewards_text(program, text),
        "initial": writer.initial(),
    }
    head = (*(header or (program.name,)), *names.header())
    return fill_in("program.prism.j2", header=head, formulas=text.take(), **sections)


class ProgramWriter:
    """Writes the parts of a program.

    Attributes:
        text: writes its expressions.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self.text = EngineText(program)
        self._by_name = {one.name: one for one in program.variables}
        self._starts = {process.name: self._possible(process) for process in program.processes}
        self._fixed = program.initial_predicate is None and all(
            len(starts) == 1 for starts in self._starts.values()
        )

    def _possible(self, process: Process) -> list[InitialValues]:
        """Return the initial values of a process that have a probability above 0."""
        return [one for one in process.initial if self.text.probability_form(one.probability) != ZERO]

    def labels(self) -> list[LabelLine]:
        """Return the labels."""
        return [LabelLine(name, self.text.truth(where)) for name, where in self._program.labels.items()]

    def module(self, process: Process) -> ModuleText:
        """Return the module of a process."""
        commands = tuple(self._command(command) for command in process.commands)
        return ModuleText(
            name=process.name,
            comment=process.meaning or f"{process.concern}: {process.name}",
            formulas=tuple(self.text.take()),
            variables=self.lines(process),
            commands=commands,
        )

    def lines(self, process: Process) -> tuple[VariableLine, ...]:
        """Return its variables; those of a process without commands any module may change."""
        return tuple(self._variable(process, one) for one in process.variables)

    def _variable(self, process: Process, variable: StateVariable) -> VariableLine:
        initial = ""
        if self._fixed:
            initial = self._value(variable.name, self._starts[process.name][0].values[variable.name])
        names = [f"{variable.low + place} {name}" for place, name in enumerate(variable.values)]
        key = [", ".join(names[first : first + KEY_WIDTH]) for first in range(0, len(names), KEY_WIDTH)]
        # a range that ends at 0 is refused by PRISM-games
        high = max(variable.high, variable.low + 1)
        domain = "bool" if variable.kind == "bool" else f"[{variable.low}..{high}]"
        return VariableLine(variable.name, domain, initial, tuple(key))

    def _value(self, name: str, value: Expression) -> str:
        if self._by_name[name].kind == "bool":
            return self.text.truth(Constant(bool(value.value)) if isinstance(value, Constant) else value)
        return self.text.whole(value)

    def _command(self, command: Command) -> CommandLine:
        """A command that is never enabled stays: its module knows the action nevertheless."""
        guard = self.text.truth_form(command.guard)
        outcomes = []
        for outcome in joint_outcomes([command]):
            probability = self.text.probability_form(outcome.probability)
            if probability != ZERO:
                outcomes.append((probability, self._assignments(outcome)))
        if guard == FALSE or not outcomes:
            return CommandLine(command.action or "", "false", "true")
        if len(outcomes) == 1:
            return CommandLine(command.action or "", wrapped(guard), outcomes[0][1])
        updates = [f"{wrapped(probability)} : {text}" for probability, text in outcomes]
        return CommandLine(command.action or "", wrapped(guard), " + ".join(updates))

    def _assignments(self, outcome: Update) -> str:
        parts = []
        for name, value in outcome.assignments.items():
            text = self._value(name, value)
            if re.search(r"[?=<>&|]", text):
                text = f"({text})"
            if text != name:
                parts.append(f"({name}'={text})")
        return " & ".join(parts) or "true"

    def initial(self) -> str:
        """Return the support of the initial distribution; nothing if it is a single state."""
        if self._fixed:
            return ""
        if self._program.initial_predicate is not None:
            return self.text.truth(self._program.initial_predicate)
        terms = [self._start(process) for process in self._program.processes if process.variables]
        return text_of(joined("&", terms))

    def _start(self, process: Process) -> Expression:
        starts = self._starts[process.name]
        first = starts[0].values
        if first.keys() != {*self._program.location}:
            options = [joined("&", [self._is(*value) for value in start.values.items()]) for start in starts]
            return joined("|", options)
        places = [{name: whole(value, name) for name, value in start.values.items()} for start in starts]
        # a variable of one value has a range of two, as PRISM-games wants it
        lone = (one.name for one in process.variables if one.low == one.high)
        own = (self._is(name, first[name]) for name in lone)
        return joined("&", [self.text.location_in(places), *own])

    def _is(self, name: str, value: Expression) -> Expression:
        own = Variable(name, 0)
        if self._by_name[name].kind != "bool":
            return self.text.truth_form(Operation("=", (own, value)))
        return own if whole(value, name) else negation(own)
