"""Processes that a case declares: variables that change with every step by their first matching change.

A change may read, with a prime, what the space or a process declared earlier becomes in the same step. Such
processes are linked: they draw one joint outcome, and are one process of the program.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import TypeAlias

from merap.concerns.document import KeyPath
from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    ONE,
    TRUE,
    ZERO,
    Constant,
    Expression,
    Operation,
    Variable,
    all_of,
    any_of,
    fold,
    none_of,
    product_of,
    variables,
)
from merap.program.form import (
    Command,
    ConcernName,
    Draw,
    InitialValues,
    Process,
    StateVariable,
    Update,
    whole,
)
from merap.program.joint_draws import joint_draws


@dataclass(frozen=True, repr=False)
class Change(ShortRepr):
    """What a step makes of a process's variables.

    Attributes:
        actions: with which it happens; None: with every declared action, never with `end`.
        where: condition on the state before the step and, primed, on what was declared earlier.
        outcomes: a distribution; variables that an outcome does not assign keep their value.
    """

    actions: frozenset[str] | None
    where: Expression
    outcomes: Draw

    def mapped(self, change: Callable[[Expression], Expression]) -> Change:
        """Return the change with every expression changed."""
        outcomes = tuple(
            Update(change(one.probability), {name: change(value) for name, value in one.assignments.items()})
            for one in self.outcomes
        )
        return Change(self.actions, change(self.where), outcomes)


@dataclass(frozen=True, repr=False)
class DeclaredProcess(ShortRepr):
    """A process as a case declares it.

    Attributes:
        name: of the process.
        concern: that owns it.
        variables: its own.
        initial: a distribution over their joint initial values.
        changes: the first that matches counts; without a match nothing changes.
        path: where the case file declares it.
    """

    name: str
    concern: ConcernName
    variables: tuple[StateVariable, ...]
    initial: tuple[InitialValues, ...]
    changes: tuple[Change, ...]
    path: KeyPath = ()

    def mapped(self, change: Callable[[Expression], Expression]) -> DeclaredProcess:
        """Return the process with every expression changed."""
        initial = tuple(
            InitialValues(
                change(one.probability), {name: change(value) for name, value in one.values.items()}
            )
            for one in self.initial
        )
        return replace(self, initial=initial, changes=tuple(one.mapped(change) for one in self.changes))

    def changes_with(self, action: str) -> list[Change]:
        """Return the changes that an action may make, in their order."""
        return [one for one in self.changes if one.actions is None or action in one.actions]

    def check_start(self) -> None:
        """Refuse initial values that are missing or out of range, and probabilities that do not sum to 1.

        What still depends on a parameter of another concern is left for later.

        Raises:
            InputError: without place.
        """
        chances = [start.probability for start in self.initial]
        known = [Fraction(chance.value) for chance in chances if isinstance(chance, Constant)]
        for chance in known:
            if not 0 <= chance <= 1:
                raise InputError(f"an initial value has the probability {float(chance):g}, not in [0, 1]")
        if len(known) == len(chances) and sum(known) != 1:
            raise InputError(f"the probabilities of initial sum to {float(sum(known)):g}, not 1")
        for start, variable in product(self.initial, self.variables):
            if variable.name not in start.values:
                raise InputError(f"an outcome of initial gives {variable.name} no value")
            given = start.values[variable.name]
            if isinstance(given, Constant):
                value = whole(given, f"the initial value of {variable.name}")
                if not variable.low <= value <= variable.high:
                    allowed = f"{variable.low}..{variable.high}"
                    raise InputError(f"the initial value of {variable.name} is {value}, allowed is {allowed}")


def as_process(declared: DeclaredProcess, actions: Sequence[str], joint: Collection[str] = ()) -> Process:
    """Return the process, with commands that exclude each other for each action that it changes with.

    Args:
        declared: the process.
        actions: of the system.
        joint: those of them with one command, whose draw is put in the place of another when processes are
            linked.
    """
    commands: list[Command] = []
    for action in actions:
        changes = declared.changes_with(action)
        place = f"[{action}] of {declared.name}"
        if action in joint or any(primed(one) for one in changes):
            commands.append(Command(action, TRUE, (draw_of(changes),), place))
        elif changes:
            guarded = _first_matches(changes)
            commands += [Command(action, guard, (outcomes,), place) for guard, outcomes in guarded]
    meaning = f"{declared.concern}: {declared.name}"
    return Process(
        declared.name, declared.concern, declared.variables, tuple(commands), declared.initial, meaning
    )


def _first_matches(changes: Sequence[Change]) -> Iterator[tuple[Expression, Draw]]:
    """Yield where each change is the first that matches; last, where none is: nothing changes."""
    before: list[Expression] = []
    for change in changes:
        yield all_of([none_of(before), change.where]), change.outcomes
        if change.where == TRUE:
            return
        before.append(change.where)
    yield none_of(before), (Update(ONE),)


def draw_of(changes: Sequence[Change]) -> Draw:
    """Return what changes draw where it is known only when they draw which of them is the first to match."""
    if all(one.outcomes == (replace(one.outcomes[0], probability=ONE),) for one in changes):
        return (Update(ONE, _decided(changes)),)
    return tuple(
        outcome if where == TRUE else Update(_where(where, outcome.probability), outcome.assignments)
        for where, own in _first_matches(changes)
        for outcome in own
    )


def _decided(changes: Sequence[Change]) -> dict[str, Expression]:
    """Return what variables become where no change draws: one outcome, whatever matches."""
    values: dict[str, Expression] = {}
    for change in reversed(changes):
        given = change.outcomes[0].assignments
        for name in {**values, **given}:
            keeps = Variable(name, 0)
            taken, other = given.get(name, keeps), values.get(name, keeps)
            values[name] = taken if change.where == TRUE else Operation("?:", (change.where, taken, other))
    return values


def _where(condition: Expression, probability: Expression) -> Expression:
    return Operation("?:", (condition, probability, ZERO))


def primed(change: Change) -> set[str]:
    """Return the names of what a change reads of the step."""
    parts = [change.where]
    for outcome in change.outcomes:
        parts += [outcome.probability, *outcome.assignments.values()]
    return {one.name[:-1] for part in parts for one in variables(part) if one.name.endswith("'")}


# For an action whose outcomes decide what processes become: for each of them process -> what it draws.
Joint: TypeAlias = Mapping[str, Sequence[Mapping[str, Draw]]]
NO_JOINT: Joint = {}


def linked(
    processes: Sequence[Process], declared: Sequence[DeclaredProcess], joint: Joint
) -> tuple[Process, ...]:
    """Put processes together that draw one outcome, where the last of them stands.

    They are those of which one reads what one before it becomes, and those that an action's outcome decides.

    Args:
        processes: all of a program, in order of declaration.
        declared: those of them that a case declares.
        joint: actions whose outcomes decide what processes become.
    """
    owner = {one.name: place for place, process in enumerate(processes) for one in process.variables}
    places = {process.name: place for place, process in enumerate(processes)}
    group = list(range(len(processes)))
    pairs = [
        (places[name], places[other])
        for outcomes in joint.values()
        for name, *others in (list(dict.fromkeys(name for drawn in outcomes for name in drawn)),)
        for other in others
    ]
    read = {one.name: {name for change in one.changes for name in primed(change)} for one in declared}
    pairs += [(owner[name], places[reader]) for reader, names in read.items() for name in sorted(names)]
    for first, second in pairs:
        old, new = group[first], group[second]
        group = [new if one == old else one for one in group]
    members = {
        one: [process for process, own in zip(processes, group, strict=True) if own == one]
        for one in sorted(set(group))
    }
    last = {max(places[process.name] for process in own): own for own in members.values()}
    return tuple(together(last[place], joint) for place in sorted(last))


def together(members: Sequence[Process], joint: Joint = NO_JOINT) -> Process:
    """Return one process that does what some do side by side; the last of them names it."""
    if len(members) == 1:
        return members[0]
    actions = dict.fromkeys(command.action for process in members for command in process.commands)
    commands: list[Command] = []
    for action in actions:
        known = {
            process.name: [one for one in process.commands if one.action == action] for process in members
        }
        known = {name: own for name, own in known.items() if own}
        for chosen in product(*known.values()):
            draws = {name: one.draws for name, one in zip(known, chosen, strict=True)}
            guard = all_of([one.guard for one in chosen])
            commands.append(
                Command(action, guard, _draws(draws, joint.get(action or "", ())), chosen[-1].place)
            )
    starts = tuple(_joint_start(chosen) for chosen in product(*(process.initial for process in members)))
    return Process(
        members[-1].name,
        members[-1].concern,
        tuple(variable for process in members for variable in process.variables),
        tuple(commands),
        starts,
        "; ".join(process.meaning for process in members),
    )


def _draws(own: Mapping[str, tuple[Draw, ...]], outcomes: Sequence[Mapping[str, Draw]]) -> tuple[Draw, ...]:
    """Return the draws of processes one after the other; one draw of all, where outcomes decide them."""
    if not own.keys() & {name for drawn in outcomes for name in drawn}:
        return tuple(draw for draws in own.values() for draw in draws)
    return (
        tuple(
            update
            for drawn in outcomes
            for update in joint_draws(
                [draw for name, draws in own.items() for draw in ([drawn[name]] if name in drawn else draws)]
            )
        ),
    )


def _joint_start(chosen: Sequence[InitialValues]) -> InitialValues:
    probability = fold(product_of(one.probability for one in chosen), {})
    return InitialValues(probability, {name: value for one in chosen for name, value in one.values.items()})


def moved(names: Sequence[str]) -> Expression:
    """Return whether a step changes any of the location variables."""
    return any_of(Operation("!=", (Variable(f"{name}'", 0), Variable(name, 0))) for name in names)
