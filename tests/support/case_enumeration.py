"""The model of a case file in plain Python and fractions, a state at a time.

A third route beside merap's exploration and Storm: it shares no code with them. It asserts what composition
promises of reachable states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from tests.support.case_expressions import evaluate
from tests.support.case_reading import (
    Composition,
    Process,
    Scope,
    condition_holds,
    goal_holds,
)

State = tuple[Any, ...]
Row = dict[State, tuple[Fraction, Fraction]]
Drawn = list[tuple[Fraction, dict[str, Any]]]
# The process that an action or outcome sets, and what it makes of it; the first that matches counts.
Sets = list[tuple[str, Any]]


@dataclass(frozen=True)
class EnumeratedCase:
    """A model; a successor is kept with its probability and the reward of the step to it.

    Attributes:
        names: of the variables of a state; locations are `loc`, or `row` and `col`.
        initial: state -> probability.
        choices: state -> action -> successors; none in a complete state.
        labels: name -> the states where it holds.
        horizon: steps of an episode.
        discount: of a step.
    """

    names: tuple[str, ...]
    initial: Mapping[State, Fraction]
    choices: Mapping[State, Mapping[str, Row]]
    labels: Mapping[str, frozenset[State]]
    horizon: int
    discount: float


def read_case_file(path: Path) -> dict[str, Any]:
    """The content of a case file."""
    content: dict[str, Any] = YAML(typ="safe", pure=True).load(path)
    return content


def enumerate_case(case: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]]) -> EnumeratedCase:
    """Return the model of one combination.

    Args:
        case: content of the case file.
        parameters: concern -> values of its parameters.
    """
    return _Enumeration(Composition(case, parameters)).run()


class _Enumeration:
    """Where the parts of a composition meet."""

    def __init__(self, composition: Composition) -> None:
        self.composition = composition
        self.innate = composition.innate
        self.objective = composition.objective
        self.variables = [name for process in composition.processes for name in process.variables]
        space = composition.case.get("space", {})
        place = ("row", "col") if "grid" in space else ("loc",) if space else ()
        mode = ("mode",) if self.innate else ()
        done = ("done",) if "ends_after" in self.objective else ()
        self.names = (*place, *mode, *self.variables, *done)

    def run(self) -> EnumeratedCase:
        initial = self.initial()
        choices: dict[State, dict[str, Row]] = {}
        labels: dict[str, set[State]] = {}
        waiting = [dict(now) for now, _ in initial]
        while waiting:
            now = waiting.pop()
            state = self.state(now)
            if state in choices:
                continue
            scope = Scope(self.composition, "objective", now)
            for name, holds in self.labels(scope).items():
                labels.setdefault(name, set()).update({state} if holds else ())
            choices[state] = {}
            if state in labels["complete"]:
                continue
            for action in self.enabled(now):
                row = choices[state].setdefault(action, {})
                for chance, after in self.steps(now, action):
                    successor = self.state(after)
                    reward = self.reward(now, action, after)
                    before, _ = row.get(successor, (Fraction(0), reward))
                    row[successor] = (before + chance, reward)
                    waiting.append(after)
                assert sum(chance for chance, _ in row.values()) == 1
            assert choices[state], f"no action in {state}"
        starts: dict[State, Fraction] = {}
        for now, chance in initial:
            starts[self.state(now)] = starts.get(self.state(now), Fraction(0)) + chance
        frozen = {name: frozenset(states) for name, states in labels.items()}
        horizon = evaluate(self.objective["horizon"], Scope(self.composition, "objective", {}))
        discount = float(self.composition.case.get("discount", 1))
        return EnumeratedCase(self.names, starts, choices, frozen, int(horizon), discount)

    def state(self, now: Mapping[str, Any]) -> State:
        read = {"row": lambda: now["at"][0], "col": lambda: now["at"][1], "loc": lambda: now["at"]}
        return tuple(read[name]() if name in read else now[name] for name in self.names)

    def labels(self, scope: Scope) -> dict[str, bool]:
        ends = self.objective.get("ends_in", False)
        found = {name: scope.holds(name) for name in self.objective.get("labels", {})}
        found["complete"] = scope.now["done"] or condition_holds(ends, scope)
        if "unsafe" in self.objective:
            found["unsafe"] = condition_holds(self.objective["unsafe"], scope)
        return found | {"goal": goal_holds(scope)}

    def initial(self) -> list[tuple[dict[str, Any], Fraction]]:
        """Every first state with its probability; one may stand there several times."""
        composition = self.composition
        start = self.objective.get("start")
        if isinstance(start, str):
            start = composition.parameters["objective"].get(start, start)
        if isinstance(start, Mapping):
            places: Drawn = [(Fraction(str(chance)), {"at": place}) for place, chance in start.items()]
        else:
            places = [(Fraction(1), {"at": tuple(start) if isinstance(start, list) else start})]
        mode = self.innate.get("initial", self.innate["modes"][0]) if self.innate else None
        drawn = [
            _outcomes(one.declaration["initial"], one, Scope(composition, one.owner, {}))
            for process in composition.processes
            for one in _starting(process)
        ]
        found = []
        for joint in product(places, *drawn):
            now: dict[str, Any] = {"mode": mode, "done": False}
            for _, values in joint:
                now |= values
            found.append((now, prod((chance for chance, _ in joint), start=Fraction(1))))
        return [(now, chance) for now, chance in found if chance]

    def enabled(self, now: dict[str, Any]) -> Iterator[str]:
        """The actions of a state that is not complete."""
        innate, scope = self.innate, Scope(self.composition, "capability", now)
        has_innate = innate and evaluate(innate.get("requires", True), scope)
        terminal = not innate or now["mode"] in innate["terminal"]
        for name, action in self.composition.case["capability"]["actions"].items():
            intended = self.composition.external(name)[0]["move"]
            gone = (action or {}).get("on_blocked") == "disable" and (
                self.composition.target(scope, intended) is None
            )
            if terminal and not gone and evaluate((action or {}).get("requires", True), scope):
                yield name
        if has_innate:
            yield from (name for name, modes in innate["actions"].items() if now["mode"] in modes)
            if terminal and innate.get("restart", True):
                yield f"start_{innate['name']}"

    def steps(self, now: dict[str, Any], action: str) -> Iterator[tuple[Fraction, dict[str, Any]]]:
        """The joint outcomes of an action; several may lead to one state."""
        end = self.objective.get("ends_after")
        ends = end is not None and condition_holds(end, Scope(self.composition, "objective", now), action)
        for chance, after, sets in self.moves(now, action):
            begun = after | {"done": ends}
            yield from self.drawn(now, begun, action, sets, self.composition.processes, chance)

    def moves(self, now: dict[str, Any], action: str) -> Iterator[tuple[Fraction, dict[str, Any], Sets]]:
        """What becomes of location and mode, with what that outcome sets and then its action."""
        declared = self.composition.case["capability"]["actions"].get(action, False)
        if declared is False:
            modes = self.innate["actions"].get(action, {now["mode"]: {self.innate["entry"]: 1}})[now["mode"]]
            for mode, chance in modes.items():
                probability = Fraction(evaluate(chance, Scope(self.composition, "capability", now)))
                if probability:
                    yield probability, {"at": now["at"], "mode": mode}, []
            return
        here, everywhere = now["at"], (declared or {}).get("sets", {}).items()
        entries = self.composition.external(action)
        scope = Scope(self.composition, "capability", now)
        targets = [self.composition.target(scope, entry["move"]) for entry in entries]
        targets = [here if target is None else target for target in targets]
        scope.after = {"at": targets[0], "mode": now["mode"]}
        chances = [Fraction(evaluate(entry["probability"], scope)) for entry in entries]
        assert (sum(chances), min(chances) >= 0) == (1, True), (action, chances)
        for entry, target, chance in zip(entries, targets, chances, strict=True):
            if chance:
                own = entry.get("sets", {}).items()
                yield chance, {"at": target, "mode": now["mode"]}, [*own, *everywhere]

    def drawn(
        self,
        now: dict[str, Any],
        after: dict[str, Any],
        action: str,
        sets: Sets,
        waiting: list[Process],
        chance: Fraction,
    ) -> Iterator[tuple[Fraction, dict[str, Any]]]:
        """Let the processes draw one after another; each reads what those before it have become."""
        if not waiting:
            yield chance, after
            return
        process, *rest = waiting
        kept = {name: now[name] for name in process.variables}
        for part, values in self.changed(process, now, after, action, sets):
            yield from self.drawn(now, after | kept | values, action, sets, rest, chance * part)

    def changed(
        self,
        process: Process,
        now: dict[str, Any],
        after: dict[str, Any],
        action: str,
        sets: Sets,
    ) -> Drawn:
        """The distribution of a process's next values, by the first change that matches."""
        if process.frozen:
            return [(Fraction(1), {})]
        placed = [
            change if isinstance(change, Mapping) and "set" in change else {"set": change}
            for name, change in sets
            if name == process.name
        ]
        changes = [(change, "capability") for change in placed]
        changes += [(change, process.owner) for change in process.declaration.get("changes") or []]
        for change, owner in changes:
            scope = Scope(self.composition, owner, now, after)
            actions = change.get("action", "any")
            listed = [actions] if isinstance(actions, str) else actions
            if ("any" in listed or action in listed) and evaluate(change.get("where", True), scope):
                return _outcomes(change["set"], process, scope)
        return [(Fraction(1), {})]

    def reward(self, now: dict[str, Any], action: str, after: dict[str, Any]) -> Fraction:
        """The value of the first rule that matches a step."""
        scope = Scope(self.composition, "objective", now, after)
        for rule in self.objective.get("rewards", []):
            if condition_holds(rule, scope, action):
                return Fraction(evaluate(rule["value"], scope))
        return Fraction(0)


def _starting(process: Process) -> list[Process]:
    """What draws its first values on its own: a process, or each of its variables."""
    if "initial" in process.declaration:
        return [process]
    return [Process(name, process.owner, {name: one}, one) for name, one in process.variables.items()]


def _outcomes(given: Any, process: Process, scope: Scope) -> Drawn:
    """The distribution that `set` or `initial` means."""
    if not isinstance(given, list):
        return [(Fraction(1), process.values(given, scope))]
    drawn: Drawn = []
    left = Fraction(1)
    for entry in given:
        chance = left if "otherwise" in entry else Fraction(evaluate(entry["probability"], scope))
        assert 0 <= chance <= left, f"{process.name}: {entry} has probability {chance}"
        left -= chance
        if chance:
            values = entry["otherwise"] if "otherwise" in entry else entry["value"]
            drawn.append((chance, process.values(values, scope)))
    assert left == 0, f"{process.name}: {left} is left over"
    return drawn
