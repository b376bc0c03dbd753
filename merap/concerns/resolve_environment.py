"""Resolve configurations of the environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from merap.concerns.closing import names_in_part, with_values
from merap.concerns.combination import Environment
from merap.concerns.parameters import (
    Edge,
    ParameterValue,
    Values,
    constants,
    held_locations,
    parameter_name,
    present_all,
)
from merap.concerns.reachability import leaves_goals_reachable
from merap.concerns.resolution_context import ResolutionContext, frozen
from merap.concerns.resolve_processes import process_entries, resolve_processes
from merap.concerns.resolve_space import apply_settings
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_base import Box
from merap.concerns.space import Attribute, Door
from merap.mdp.model import Bools, Ints
from merap.program.names import suggestion

BLOCKED = "blocked"
BLOCKED_EDGES = "blocked_edges"
LOCKED = "locked"


class EnvironmentResolver:
    """Makes environments from parameter values; call it with a name and values.

    Raises:
        InputError: an expression is wrong, or an attribute unknown.
    """

    def __init__(self, context: ResolutionContext, case: CaseSpec) -> None:
        self.context = context
        self.spec = case.environment
        self._known_attributes: dict[tuple[ParameterValue, ...], tuple[Attribute, ...]] = {}
        self._no_edges = frozen(np.zeros(context.space.target.shape, dtype=np.bool_))
        processes = resolve_processes(context, process_entries(case, "environment"))
        self.template = Environment("", {}, context.mask(()), self._no_edges, (), processes)
        known = [attribute.name for attribute in context.space.attributes]
        for name in self.spec.attributes:
            if name not in known:
                raise context.document.error(
                    ("environment", "attributes", name),
                    f"unknown attribute {name!r}{suggestion(name, known)}",
                )

    def __call__(self, name: str, values: Values) -> Environment:
        """The environment called `name`.

        Raises:
            InputError: a value that a parameter puts into an attribute is not allowed.
        """
        known = constants("environment", self.spec.parameters, values, self.context.space)
        found = replace(
            self.template,
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            blocked=self.context.mask(held_locations(values, BLOCKED)),
            blocked_edges=self._blocked_edges(values),
            locked=frozenset(door.name for door in self._locked(values)),
            attributes=self._attributes(values),
        )
        return with_values(self.context.document, found, known, f"environment {name}")

    def _blocked_edges(self, values: Values) -> Bools:
        edges: tuple[Edge, ...] = values.get(BLOCKED_EDGES, ())  # type: ignore[assignment]
        locked = self._locked(values)
        if not edges and not locked:
            return self._no_edges
        mask = np.zeros_like(self._no_edges)
        if edges:
            mask[tuple(np.array(edges).T)] = True
        for door in locked:
            mask |= door.edges
        return frozen(mask)

    def _locked(self, values: Values) -> list[Door]:
        held: tuple[int, ...] = values.get(LOCKED, ())  # type: ignore[assignment]
        return [self.context.space.doors[index] for index in held]

    def _attributes(self, values: Values) -> tuple[Attribute, ...]:
        """Shared by all configurations that agree on what the attributes read."""
        key = tuple(values[name] for name in sorted(self._settings_read()))
        if key not in self._known_attributes:
            self._known_attributes[key] = self._set_attributes(values)
        return self._known_attributes[key]

    def _set_attributes(self, values: Values) -> tuple[Attribute, ...]:
        if not self.spec.attributes:
            return self.context.space.attributes
        types = self.spec.parameters
        numbers = {
            name: float(value) if isinstance(value, Fraction) else value
            for name, value in values.items()
            if isinstance(value, Fraction | bool)
        }
        return tuple(
            apply_settings(
                self.context.document,
                ("environment", "attributes", attribute.name),
                attribute,
                self.spec.attributes.get(attribute.name, ()),
                find=lambda refs: self.context.select(refs, types, values),
                parameters=numbers,
            )
            for attribute in self.context.space.attributes
        )

    def names_read(self) -> set[str]:
        """Return the resolved names of the parameters that attributes and processes read."""
        own = {parameter_name("environment", name) for name in self._settings_read()}
        return own | names_in_part(self.template)

    def _settings_read(self) -> set[str]:
        """Return the parameters that the attributes read."""
        settings = [setting for entry in self.spec.attributes.values() for setting in entry]
        read = {setting.value for setting in settings if isinstance(setting.value, str)}
        places = [setting.at for setting in settings if not isinstance(setting.at, Box)]
        read |= {ref for refs in places for ref in refs if isinstance(ref, str)}
        return read & set(self.spec.parameters)

    def leaves_goals_reachable(self, starts: Ints, goals: Ints, listed: Sequence[Values]) -> Bools:
        """bool [N]: which of N values leave every goal reachable from every start.

        Args:
            starts: indices of locations.
            goals: indices of locations.
            listed: N values of the parameters.
        """
        closed = np.zeros((len(listed), self.context.space.num_locations), dtype=np.bool_)
        held = [held_locations(values, BLOCKED) for values in listed]
        rows = np.repeat(np.arange(len(listed)), [len(locations) for locations in held])
        closed[rows, np.array([location for locations in held for location in locations], dtype=np.int64)] = (
            True
        )
        edges = None
        if {BLOCKED_EDGES, LOCKED} & self.spec.parameters.keys():
            edges = np.stack([self._blocked_edges(values) for values in listed])
        return leaves_goals_reachable(self.context.space, starts, goals, closed, edges)
