"""The model of a program by fractions in pure Python, a state at a time: a route that shares no code."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any

from merap.program.expressions import Constant, Expression, Lookup, Operation, Variable
from merap.program.form import Command, Draw, Program

State = tuple[Any, ...]


def value_of(expression: Expression, state: Mapping[str, Any]) -> Any:
    """Evaluate by the meaning of the operators; raises ZeroDivisionError or IndexError."""
    match expression:
        case Constant(value):
            return value
        case Variable(name):
            return state[name]
        case Lookup(table, index):
            number = value_of(index, state)
            if Fraction(number).denominator != 1 or not 0 <= number < len(table.column.codes):
                raise IndexError
            return table.column.levels.values[table.column.codes[int(number)]]
        case Operation("?:", (condition, taken, other)):
            return value_of(taken if value_of(condition, state) else other, state)
        case Operation("&" | "|" | "=>" as symbol, (left, right)):
            first = value_of(left, state) != (symbol == "=>")
            return value_of(right, state) if first == (symbol == "&") else first
        case Operation(symbol, arguments):
            return MEANINGS[symbol](*(value_of(argument, state) for argument in arguments))


MEANINGS: Mapping[str, Callable[..., Any]] = {
    "!": lambda a: not a,
    "=": lambda a, b: a == b,
    "<=>": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "neg": lambda a: -a,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: Fraction(a) / b,
    "min": min,
    "max": max,
    "floor": lambda a: Fraction(a // 1),
    "ceil": lambda a: Fraction(-(-a // 1)),
    "mod": lambda a, b: a - b * (Fraction(a) / b // 1),
}


class BrokenError(Exception):
    """The program is wrong in a reachable state."""


def enumerate_model(
    program: Program,
) -> tuple[dict[State, float], dict[State, list[tuple[str | None, dict[State, Fraction]]]]]:
    """Return initial states with their probabilities, and the choices of every reachable state.

    Raises:
        BrokenError: a reachable state has a fault.
    """
    names = [one.name for one in program.variables]
    kinds = {one.name: one for one in program.variables}
    initial: dict[State, float] = {}
    for starts in product(*(process.initial for process in program.processes)):
        chance = Fraction(1)
        values: dict[str, Any] = {}
        for one in starts:
            chance *= Fraction(value_of(one.probability, {}))
            values |= {name: value_of(value, {}) for name, value in one.values.items()}
        if chance > 0:
            state = tuple(values[name] for name in names)
            initial[state] = initial.get(state, 0) + float(chance)
    choices: dict[State, list[tuple[str | None, dict[State, Fraction]]]] = {}
    waiting = list(initial)
    while waiting:
        state = waiting.pop()
        if state in choices:
            continue
        choices[state] = []
        now = dict(zip(names, state, strict=True))
        for action, chosen in _chosen(program, now):
            successors: dict[State, Fraction] = {}
            for chance, after in _outcomes(chosen, now, kinds):
                successor = tuple(after.get(name, now[name]) for name in names)
                successors[successor] = successors.get(successor, Fraction(0)) + chance
            choices[state].append((action, successors))
            waiting += successors
    return initial, choices


def _chosen(program: Program, now: Mapping[str, Any]) -> Iterator[tuple[str | None, list[Command]]]:
    for process in program.processes:
        for one in process.commands:
            if one.action is None and _checked(one.guard, now):
                yield None, [one]
    for action in program.actions:
        enabled = [
            [one for one in process.commands if one.action == action and _checked(one.guard, now)]
            for process in program.processes
            if action in process.actions
        ]
        for chosen in product(*enabled):
            yield action, list(chosen)
    for process in program.processes:  # engines look at every guard
        for one in process.commands:
            _checked(one.guard, now)


def _checked(expression: Expression, state: Mapping[str, Any]) -> Any:
    try:
        return value_of(expression, state)
    except (ZeroDivisionError, IndexError) as error:
        raise BrokenError from error


def _outcomes(
    commands: list[Command], now: Mapping[str, Any], kinds: Mapping[str, Any]
) -> Iterator[tuple[Fraction, dict[str, Any]]]:
    drawn = [list(_drawn(one.draws, now, kinds, {})) for one in commands]
    for joint in product(*drawn):
        chance = Fraction(1)
        after: dict[str, Any] = {}
        for part, values in joint:
            chance *= part
            after |= values
        yield chance, after


def _drawn(
    draws: Sequence[Draw], now: Mapping[str, Any], kinds: Mapping[str, Any], after: dict[str, Any]
) -> Iterator[tuple[Fraction, dict[str, Any]]]:
    if not draws:
        yield Fraction(1), after
        return
    scope = {**now, **{f"{name}'": value for name, value in {**now, **after}.items()}}
    chances = [Fraction(_checked(one.probability, scope)) for one in draws[0]]
    if sum(chances) != 1 or min(chances) < 0:
        raise BrokenError
    for chance, one in zip(chances, draws[0], strict=True):
        if chance == 0:
            continue
        new = {name: _checked(value, scope) for name, value in one.assignments.items()}
        for name, value in new.items():
            if kinds[name].kind != "bool" and not (
                Fraction(value).denominator == 1 and kinds[name].low <= value <= kinds[name].high
            ):
                raise BrokenError
        for rest, values in _drawn(draws[1:], now, kinds, {**after, **new}):
            yield chance * rest, values
