"""What a case file declares, read in plain Python by its language's text alone.

It reads the YAML file itself, shares no code with merap, and trusts the file to be well formed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from tests.support.case_expressions import evaluate

CONCERNS = ("environment", "capability", "objective")


@dataclass
class Process:
    """What changes beside location and mode.

    Attributes:
        name: of the process.
        owner: the concern that declares it, or `space`.
        variables: name -> its declaration.
        declaration: of the process.
        frozen: keeps its values whatever happens.
    """

    name: str
    owner: str
    variables: Mapping[str, Mapping[str, Any]]
    declaration: Mapping[str, Any]
    frozen: bool = False

    def values(self, given: Any, scope: Scope) -> dict[str, Any]:
        """What an entry of `set` or `initial` gives the variables."""
        if "variables" in self.declaration:
            given = given or {}
            assert set(given) <= set(self.variables), given
        else:
            given = {self.name: given}
        return {name: self._checked(name, evaluate(value, scope)) for name, value in given.items()}

    def _checked(self, name: str, value: Any) -> Any:
        declared = self.variables[name]
        if "range" in declared:
            low, high = declared["range"]
            assert low <= value <= high, f"{name} = {value}"
            assert Fraction(value).denominator == 1, f"{name} = {value}"
        elif "values" in declared:
            assert value in declared["values"], f"{name} = {value}"
        else:
            assert isinstance(value, bool), f"{name} = {value}"
        return value


class Space:
    """Locations, edges, attributes; without a `space`, one place."""

    def __init__(self, declared: Mapping[str, Any] | None) -> None:
        self.declared = declared or {"locations": {None: [0, 0]}, "edges": []}
        self.grid = self.declared.get("grid")
        self.edges: dict[tuple[Any, str], Any] = {}
        if self.grid:
            self.locations = [(r, c) for r in range(self.grid["rows"]) for c in range(self.grid["cols"])]
            for label, (down, right) in self.grid["moves"].items():
                for row, col in self.locations:
                    if (row + down, col + right) in self.locations:
                        self.edges[(row, col), label] = (row + down, col + right)
        else:
            self.locations = list(self.declared["locations"])
            self.edges = {(origin, label): target for origin, target, label in self.declared["edges"]}

    def places(self, given: Any, parameters: Mapping[str, Any]) -> frozenset[Any]:
        """The locations that a name, a cell, a box, a parameter or a list of them means."""
        if isinstance(given, str):
            named = given.split(".")[-1]
            return self.places(parameters[named], {}) if named in parameters else frozenset({given})
        if isinstance(given, Mapping):
            (top, bottom), (left, right) = given["rows"], given["cols"]
            return frozenset((r, c) for r in range(top, bottom + 1) for c in range(left, right + 1))
        if self.grid and len(given) == 2 and all(isinstance(part, int) for part in given):
            return frozenset({tuple(given)})
        return frozenset().union(*(self.places(one, parameters) for one in given))


class Composition:
    """One combination of a case: what its states, actions and steps are.

    Args:
        case: content of the case file.
        parameters: concern -> values of its parameters.
    """

    def __init__(self, case: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]]) -> None:
        self.case, self.parameters = case, parameters
        self.space = Space(case.get("space"))
        self.all_parameters = {name: value for one in CONCERNS for name, value in parameters[one].items()}
        self.processes = list(self._processes())
        self.innate = case["capability"].get("innate")
        self.mode_name = ("mode",) if self.innate else ()
        self.objective = case["objective"]
        environment, capability = parameters["environment"], parameters["capability"]
        self.closed = self.space.places(environment.get("blocked", []), {})
        self.closed |= self.space.places(capability.get("no_entry", []), {})
        self.closed_edges = {
            tuple(tuple(part) if isinstance(part, list) else part for part in edge)
            for edge in environment.get("blocked_edges", [])
        }
        self.attributes = {
            name: self._attribute(name, declared)
            for name, declared in self.space.declared.get("attributes", {}).items()
        }
        self.owners = self._owners()

    def _processes(self) -> Iterator[Process]:
        locked = self.parameters["environment"].get("locked", [])
        for name, door in self.space.declared.get("doors", {}).items():
            declared = {"type": "bool", "initial": door.get("open", True), "changes": door.get("changes", [])}
            yield Process(name, "space", {name: declared}, declared, name in locked)
        for owner in CONCERNS:
            for name, declared in (self.case[owner].get("processes") or {}).items():
                yield Process(name, owner, declared.get("variables") or {name: declared}, declared)

    def _attribute(self, name: str, declared: Mapping[str, Any]) -> dict[Any, Any]:
        kind = declared.get("type", "int")
        found = dict.fromkeys(self.space.locations, declared.get("default", False if kind == "bool" else 0))
        changed = self.case["environment"].get("attributes", {}).get(name, {})
        for layer in (declared.get("values", {}), changed):
            entries = layer.items() if isinstance(layer, Mapping) else ((e["at"], e["value"]) for e in layer)
            for at, value in entries:
                given = self.parameters["environment"].get(value, value) if isinstance(value, str) else value
                found |= dict.fromkeys(self.space.places(at, self.parameters["environment"]), given)
        return found

    def _owners(self) -> dict[str, dict[str, str]]:
        """Concern or `space` -> the names it declares -> what they are."""
        owners: dict[str, dict[str, str]] = {one: {} for one in ("space", *CONCERNS)}
        for name in self.attributes:
            owners["space"][name] = "attribute"
        for one in CONCERNS:
            owners[one] |= dict.fromkeys(self.parameters[one], "parameter")
        for process in self.processes:
            owners[process.owner] |= dict.fromkeys(process.variables, "variable")
        return owners

    def external(self, name: str) -> list[dict[str, Any]]:
        """The outcomes of an action, the intended one first."""
        action = self.case["capability"]["actions"][name] or {}
        if "outcomes" in action:
            return list(action["outcomes"])
        if "move" not in action:
            return [{"move": "stay", "probability": 1}]
        probability = action.get("probability", 1)
        other = {"move": action.get("otherwise", "stay"), "probability": f"1 - ({probability})"}
        return [{"move": action["move"], "probability": probability}, other]

    def target(self, scope: Scope, move: str) -> Any:
        """Where a move leads; None if it is blocked."""
        here = scope.now["at"]
        if move == "stay":
            return here
        there = self.space.edges.get((here, move))
        shut = any(
            {here, there} == set(door["between"]) and (self._door(name).frozen or not scope.now[name])
            for name, door in self.space.declared.get("doors", {}).items()
        )
        shut |= bool({(here, there), (here, there, move)} & self.closed_edges)
        return None if there is None or shut or there in self.closed else there

    def _door(self, name: str) -> Process:
        return next(one for one in self.processes if one.name == name)


@dataclass
class Scope:
    """What expressions of a concern read in a state, and in the step being drawn.

    Attributes:
        composition: the combination.
        owner: whose names come first.
        now: variables, `at` and `mode` before the step.
        after: those that are drawn already.
    """

    composition: Composition
    owner: str
    now: dict[str, Any]
    after: dict[str, Any] = field(default_factory=dict)

    def of(self, owner: str) -> Scope:
        """The same state and step, read by another concern."""
        return Scope(self.composition, owner, self.now, self.after)

    def value(self, name: str) -> Any:
        """The value of a name, which may end in a prime; a name that nobody declares is a named value."""
        plain, values = name.rstrip("'"), self.after if name.endswith("'") else self.now
        owners = self.composition.owners
        qualifier, _, last = plain.rpartition(".")
        declaring = [one for one in owners if last in owners[one]]
        if qualifier or self.owner in declaring:
            declaring = [qualifier or self.owner]
        assert len(declaring) < 2, f"{name} is ambiguous"
        if not declaring:
            return self._word(plain, values)
        kind = owners[declaring[0]][last]
        if kind == "parameter":
            return evaluate(self.composition.parameters[declaring[0]][last], self)
        return (
            evaluate(self.composition.attributes[last][values["at"]], self)
            if kind == "attribute"
            else values[last]
        )

    def _word(self, name: str, values: Mapping[str, Any]) -> Any:
        if name in ("row", "col") and self.composition.space.grid:
            return Fraction(values["at"][name == "col"])
        if name == "moved":
            return self.after["at"] != self.now["at"]
        return values["mode"] if name == "mode" else name

    def holds(self, label: str) -> bool:
        """Whether a label of the objective holds."""
        declared = self.composition.objective.get("labels", {})
        if label in declared:
            return bool(evaluate(declared[label], self.of("objective")))
        return goal_holds(self)

    def is_at(self, places: Any, *, after: bool) -> bool:
        """Whether the location is one of some places."""
        found = self.composition.space.places(places, self.composition.all_parameters)
        return (self.after if after else self.now)["at"] in found


def goal_holds(scope: Scope) -> bool:
    """The objective's goal: an expression, or to be at the parameter `goal`."""
    objective = scope.composition.objective
    if "goal" in objective:
        return bool(evaluate(objective["goal"], scope.of("objective")))
    goal = scope.composition.parameters["objective"].get("goal")
    return goal is not None and scope.is_at(goal, after=False)


def condition_holds(given: Any, scope: Scope, action: str | None = None) -> bool:
    """Whether an expression, or a mapping of conditions, holds."""
    if not isinstance(given, Mapping):
        return bool(evaluate(given, scope))
    return all(_clause_holds(key, wanted, scope, action) for key, wanted in given.items() if key != "value")


def _clause_holds(key: str, wanted: Any, scope: Scope, action: str | None) -> bool:
    listed = wanted if isinstance(wanted, Sequence) and not isinstance(wanted, str) else [wanted]
    if key in ("mode", "to_mode"):
        return (scope.now if key == "mode" else scope.after)["mode"] in listed
    if key == "to" and isinstance(wanted, Mapping) and "rows" not in wanted:
        arrived = Scope(scope.composition, scope.owner, scope.after)
        return all(_clause_holds(name, value, arrived, None) for name, value in wanted.items())
    if key in ("at", "to"):
        return scope.is_at(wanted, after=key == "to")
    if key == "action":
        return action in listed
    return bool(evaluate(wanted, scope) if key == "where" else scope.value(key) == evaluate(wanted, scope))
