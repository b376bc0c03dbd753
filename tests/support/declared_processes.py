"""What a step does to location, mode and declared processes: by definition, a state at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

from merap.concerns.combination import DeclaredCombination
from merap.concerns.processes import Change, DeclaredProcess
from merap.program.expressions import Constant
from merap.program.form import Update
from tests.support.program_enumeration import value_of

State = Mapping[str, Any]
Branch = tuple[Fraction, dict[str, Any]]


def successors(combination: DeclaredCombination, state: State, action: str) -> list[Branch]:
    """Every joint outcome of an action that is enabled, in order of the draws."""
    found = []
    for chance, after in _world(combination, state, action):
        for rest, values in _drawn(combination, list(_ordered(combination)), state, action, after):
            found.append((chance * rest, values))
    return found


def enabled(combination: DeclaredCombination, state: State) -> Iterator[str]:
    capability = combination.capability
    terminal = capability.innate is None or state["mode"] in capability.innate.terminal
    for action in capability.external:
        move = action.outcomes[0].move
        disabled = action.on_blocked == "disable" and move is not None
        if disabled and not combination.passable[state["loc"], move]:
            continue
        if terminal and value_of(action.requires, _scope(combination, state, state)):
            yield action.name
    if capability.innate is not None:
        for innate in capability.innate.actions:
            if state["mode"] in innate.chances:
                yield innate.name
        if capability.innate.restart and terminal:
            yield capability.innate.start_action


def _ordered(combination: DeclaredCombination) -> Iterator[DeclaredProcess]:
    for concern in ("environment", "capability", "objective"):
        yield from (one for one in combination.processes if one.concern == concern)


def _world(combination: DeclaredCombination, state: State, action: str) -> Iterator[Branch]:
    """Where an action leads: location and mode."""
    here, mode = state["loc"], state["mode"]
    innate = combination.capability.innate
    for external in combination.capability.external:
        if external.name == action:
            there = [_target(combination, here, outcome.move) for outcome in external.outcomes]
            scope = _scope(combination, state, {**state, "loc": there[0]})
            for outcome, target in zip(external.outcomes, there, strict=True):
                yield Fraction(value_of(outcome.probability, scope)), {"loc": target, "mode": mode}
    if innate is not None:
        for one in innate.actions:
            if one.name == action:
                for successor, chance in one.chances[mode].items():
                    yield chance, {"loc": here, "mode": successor}
        if action == innate.start_action:
            yield Fraction(1), {"loc": here, "mode": innate.entry}


def _target(combination: DeclaredCombination, here: int, move: int | None) -> int:
    if move is None or not combination.passable[here, move]:
        return here
    return int(combination.space.target[here, move])


def _scope(combination: DeclaredCombination, before: State, after: State) -> dict[str, Any]:
    scope: dict[str, Any] = dict(before)
    scope |= {f"{name}'": value for name, value in {**before, **after}.items()}
    for prime, at in (("", before["loc"]), ("'", after.get("loc", before["loc"]))):
        for attribute in combination.environment.attributes:
            levels = attribute.column.levels.values
            scope[f"{attribute.name}{prime}"] = levels[attribute.column.codes[at]]
    return scope


def _drawn(
    combination: DeclaredCombination,
    processes: list[DeclaredProcess],
    before: State,
    action: str,
    after: dict[str, Any],
) -> Iterator[Branch]:
    if not processes:
        yield Fraction(1), after
        return
    scope = _scope(combination, before, after)
    for outcome in _first_match(processes[0].changes, action, scope):
        chance = Fraction(value_of(outcome.probability, scope))
        if chance:
            own = {name: value_of(value, scope) for name, value in outcome.assignments.items()}
            for rest, values in _drawn(combination, processes[1:], before, action, {**after, **own}):
                yield chance * rest, values


def _first_match(changes: tuple[Change, ...], action: str, scope: State) -> tuple[Update, ...]:
    for change in changes:
        if (change.actions is None or action in change.actions) and value_of(change.where, scope):
            return change.outcomes
    return (Update(Constant(Fraction(1))),)
