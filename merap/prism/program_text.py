"""Write a program as PRISM text that Storm and PRISM-games read alike.

One module for each process, in the order of the program; the same program gives the same bytes. Commands that
draw several times get their joint outcomes. Every decision is one on whole numbers, and a probability is
one of the fractions that it can be, so that no engine adds or subtracts probabilities.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from merap.errors import InputError
from merap.prism.engine_form import engine_form
from merap.prism.exact_form import Domains, exact_truth, exact_whole, rounded_number, table
from merap.prism.rendering import environment
from merap.program.expressions import (
    Constant,
    Expression,
    Operation,
    fold,
    render,
    render_constant,
    substitute,
)
from merap.program.form import (
    Command,
    Draw,
    Outcome,
    Process,
    Program,
    RewardRule,
    RewardStructure,
    StateVariable,
)

MAX_OUTCOMES = 256


@dataclass(frozen=True)
class VariableLine:
    """`name : domain init initial; // meaning`."""

    name: str
    domain: str
    initial: str
    meaning: str


@dataclass(frozen=True)
class CommandLine:
    """`[action] guard -> updates;`."""

    action: str
    guard: str
    updates: str


@dataclass(frozen=True)
class ModuleText:
    """A module; the comment says whose it is."""

    name: str
    comment: str
    variables: tuple[VariableLine, ...]
    commands: tuple[CommandLine, ...]


@dataclass(frozen=True)
class LabelLine:
    """`label "name" = text;`."""

    name: str
    text: str


@dataclass(frozen=True)
class RewardsText:
    """`rewards "name"`, and `[action] guard : value` lines."""

    name: str
    items: tuple[str, ...]


def render_program(program: Program, header: tuple[str, ...] = ()) -> str:
    """Return the PRISM text of a closed program.

    Args:
        program: without open parameters; rewards read no successor.
        header: lines of comment at the top.

    Raises:
        InputError: an expression can't be written exactly; a command has more than 256 joint outcomes.
    """
    writer = _Writer(program)
    shared = [process for process in program.processes if not process.commands]
    template = environment().get_template("program.prism.j2")
    return template.render(
        header=header or (program.name,),
        shared=[line for process in shared for line in writer.lines(process)],
        processes=[writer.module(process) for process in program.processes if process.commands],
        initial=writer.initial(),
        labels=[LabelLine(name, writer.truth(where)) for name, where in program.labels.items()],
        rewards=[writer.rewards(name, structure) for name, structure in program.rewards.items()],
    )


class _Writer:
    def __init__(self, program: Program) -> None:
        self._program = program
        self._domains: Domains = {
            one.name: None if one.kind == "bool" else (one.low, one.high) for one in program.variables
        }
        starts = [process.initial for process in program.processes]
        self._fixed = program.initial_predicate is None and all(len(own) == 1 for own in starts)

    def truth(self, condition: Expression) -> str:
        return render(exact_truth(engine_form(condition), self._domains))

    def module(self, process: Process) -> ModuleText:
        return ModuleText(
            name=process.name,
            comment=f"{process.concern}: {process.name}",
            variables=self.lines(process),
            commands=tuple(self._command(command) for command in process.commands),
        )

    def lines(self, process: Process) -> tuple[VariableLine, ...]:
        """Its variables; those of a process without commands belong to no module, and any may change them."""
        return tuple(self._variable(process, one) for one in process.variables)

    def _variable(self, process: Process, variable: StateVariable) -> VariableLine:
        initial = ""
        if self._fixed:
            initial = self._value(variable, process.initial[0].values[variable.name])
        names = ", ".join(f"{variable.low + place} {name}" for place, name in enumerate(variable.values))
        # a range that ends at 0 is refused by PRISM-games
        high = max(variable.high, variable.low + 1)
        domain = "bool" if variable.kind == "bool" else f"[{variable.low}..{high}]"
        return VariableLine(variable.name, domain, initial, names)

    def _value(self, variable: StateVariable, value: Expression) -> str:
        if variable.kind == "bool" and isinstance(value, Constant):
            return render_constant(bool(value.value))
        return render(exact_whole(engine_form(value), self._domains))

    def _command(self, command: Command) -> CommandLine:
        """A command that is never enabled stays: its module knows the action nevertheless."""
        guard = exact_truth(engine_form(command.guard), self._domains)
        updates = []
        for outcome in _joint(command):
            probability = table(engine_form(outcome.probability), self._domains)
            if not (isinstance(probability, Constant) and probability.value == 0):
                updates.append(f"{_wrapped(probability)} : {self._assignments(outcome)}")
        if guard == Constant(False) or not updates:
            return CommandLine(command.action or "", "false", "true")
        return CommandLine(command.action or "", _wrapped(guard), " + ".join(updates))

    def _assignments(self, outcome: Outcome) -> str:
        parts = []
        for name, value in outcome.assignments.items():
            if self._domains[name] is None:
                text = self.truth(value)
            else:
                text = render(exact_whole(engine_form(value), self._domains))
            parts.append(f"({name}'={text})")
        return " & ".join(parts) or "true"

    def initial(self) -> str:
        """The support of the initial distribution, where it is no single state."""
        if self._fixed:
            return ""
        if self._program.initial_predicate is not None:
            return self.truth(self._program.initial_predicate)
        by_name = {one.name: one for one in self._program.variables}
        conditions = []
        for process in self._program.processes:
            if not process.variables:
                continue
            options = []
            for start in process.initial:
                terms = [
                    f"{name}={self._value(by_name[name], value)}" for name, value in start.values.items()
                ]
                options.append(f"({' & '.join(terms)})")
            conditions.append(f"({' | '.join(options)})" if len(options) > 1 else options[0])
        return " & ".join(conditions)

    def rewards(self, name: str, structure: RewardStructure) -> RewardsText:
        items: list[str] = []
        before: list[RewardRule] = []
        for rule in structure.rules:
            guard = rule.guard
            if structure.first_match:
                for other in before:
                    if not other.actions or not rule.actions or other.actions & rule.actions:
                        guard = Operation("&", (guard, Operation("!", (other.guard,))))
                before.append(rule)
            items += self._items(rule, guard)
        return RewardsText(name, tuple(items) or ("true : 0",))

    def _items(self, rule: RewardRule, guard: Expression) -> Iterator[str]:
        condition = exact_truth(engine_form(guard), self._domains)
        value = rounded_number(engine_form(rule.value), self._domains)
        text = f"{_wrapped(condition)} : {_wrapped(value)}"
        if not rule.actions:
            yield text
        for action in sorted(rule.actions & {None, *self._program.actions}, key=lambda name: name or ""):
            yield f"[{action or ''}] {text}"


def _wrapped(expression: Expression) -> str:
    """Return its text, in parentheses where a `:` in it might be taken for the item's."""
    text = render(expression)
    return f"({text})" if isinstance(expression, Operation) and expression.operator == "?:" else text


def _joint(command: Command) -> Iterator[Outcome]:
    """Every joint outcome of a command's draws, in terms of the state before the step.

    Raises:
        InputError: there are more than 256.
    """
    count = 1
    for draw in command.draws:
        count *= len(draw)
    if count > MAX_OUTCOMES:
        raise InputError(
            f"a command of [{command.action or ''}] has {count} joint outcomes, "
            f"at most {MAX_OUTCOMES} are allowed"
        )
    for outcomes in product(*command.draws):
        yield _combined(outcomes)


def _combined(outcomes: Draw) -> Outcome:
    known: dict[str, Expression] = {}
    probability: Expression = Constant(True)
    for place, outcome in enumerate(outcomes):
        primed = {f"{name}'": value for name, value in known.items()}
        own = substitute(outcome.probability, primed)
        probability = own if place == 0 else Operation("*", (probability, own))
        known |= {name: substitute(value, primed) for name, value in outcome.assignments.items()}
    return Outcome(fold(probability, {}), known)
