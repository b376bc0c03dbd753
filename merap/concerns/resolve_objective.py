"""Resolve configurations of the objective."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.concerns.closing import names_in_part, with_values
from merap.concerns.combination import DeclaredObjective, RewardRule
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import STEP
from merap.concerns.horizon import check_horizon, horizon_of
from merap.concerns.parameters import Values, constants, parameter_name, present_all
from merap.concerns.reserved_words import check_label_name
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_conditions import Labels, resolve_condition
from merap.concerns.resolve_processes import process_entries, resolve_processes
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_objective import ObjectiveSpec, PredicateSpec, StartPoint
from merap.errors import InputError
from merap.mdp.model import ROW_SUM_TOLERANCE, Floats
from merap.mdp.reserved_names import GOAL_LABEL, UNSAFE_LABEL
from merap.program.names import check_name

START = ("objective", "start")


class ObjectiveResolver:
    """Makes objectives from parameter values; call it with a name and values.

    Raises:
        InputError: an expression is wrong, or a mode, action or label unknown.
    """

    def __init__(self, context: ResolutionContext, case: CaseSpec) -> None:
        self.spec = spec = case.objective
        self.context = context = replace(context, labels=Labels(context, _label_specs(context, spec)))
        self.template = self._template(case)
        check_horizon(context.document, spec.horizon, spec.parameters)
        for name in spec.properties:
            with context.document.at("objective", "properties", name):
                check_name(name, "a property")

    def _template(self, case: CaseSpec) -> DeclaredObjective:
        """Return what the file says of the objective, its parameters without values."""
        context, spec, path = self.context, self.spec, ("objective",)
        labels = {label.strip('"'): where for label, where in context.labels.items()}
        states, steps = context.names("objective"), context.names("objective", primed=STEP)
        ends_in, ends_after = (
            None if end is None else resolve_condition(context, (*path, key), end, states)
            for key, end in (("ends_in", spec.ends_in), ("ends_after", spec.ends_after))
        )
        return DeclaredObjective(
            name="",
            parameters={},
            start=np.zeros(context.space.num_locations),
            horizon=0,
            goal=labels.pop(GOAL_LABEL, None),
            unsafe=labels.pop(UNSAFE_LABEL, None),
            labels=labels,
            rules=tuple(
                RewardRule(
                    resolve_condition(context, (*path, "rewards", index), rule, steps),
                    context.compile((*path, "rewards", index, "value"), rule.value, steps, "number"),
                )
                for index, rule in enumerate(spec.rewards)
            ),
            ends_after=ends_after,
            ends_in=None if ends_in is None else ends_in.where,
            properties=dict(spec.properties),
            processes=resolve_processes(context, process_entries(case, "objective")),
        )

    def __call__(
        self,
        name: str,
        values: Values,
        start: tuple[KeyPath, tuple[StartPoint, ...]] | None = None,
        horizon: int | None = None,
    ) -> DeclaredObjective:
        """The objective called `name`.

        Args:
            name: of the configuration.
            values: of its parameters.
            start: in place of the declared one, with its place in the file.
            horizon: in place of the declared one.

        Raises:
            InputError: a location is unknown, or an expression undefined.
        """
        known = constants("objective", self.spec.parameters, values, self.context.space)
        path, points = start or (START, self.spec.start)
        found = replace(
            self.template,
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            start=self._start(path, points, values),
            horizon=horizon or horizon_of(self.context.document, self.spec.horizon, name, values),
        )
        return with_values(self.context.document, found, known, f"objective {name}")

    def _start(self, path: KeyPath, points: tuple[StartPoint, ...], values: Values) -> Floats:
        space = self.context.space
        if not space.located:
            if points:
                raise self.context.document.error(path, "a case without space has no start")
            return np.ones(1)
        start = np.zeros(space.num_locations)
        for number, point in enumerate(points):
            with self.context.document.at(*path, number):
                indices = self.context.select((point.at,), self.spec.parameters, values)
                if len(indices) != 1:
                    raise InputError(f"{point.at!r} holds {len(indices)} locations, a start point is one")
                start[indices[0]] += point.probability
        if abs(start.sum() - 1) > ROW_SUM_TOLERANCE:
            raise self.context.document.error(path, f"the start distribution sums to {start.sum():g}, not 1")
        start.flags.writeable = False
        return start

    def names_read(self) -> set[str]:
        """Return the resolved names that expressions, locations, the start or the horizon read."""
        held = [*(point.at for point in self.spec.start), self.spec.horizon]
        own = {parameter_name("objective", one) for one in held if isinstance(one, str)}
        return own | names_in_part(self.template)


def _label_specs(context: ResolutionContext, spec: ObjectiveSpec) -> dict[str, tuple[KeyPath, PredicateSpec]]:
    """Return what each label stands for: at the parameter `goal` is the goal, if nothing else is said."""
    specs: dict[str, tuple[KeyPath, PredicateSpec]] = {}
    for name, where in spec.labels.items():
        path = ("objective", "labels", name)
        with context.document.at(*path):
            check_label_name(name)
        text = where if isinstance(where, str) else str(where).lower()
        specs[name] = path, PredicateSpec(where=text)
    goal = spec.goal
    if goal is None and GOAL_LABEL in spec.parameters:
        goal = PredicateSpec(at=(GOAL_LABEL,))
    for name, condition in ((GOAL_LABEL, goal), (UNSAFE_LABEL, spec.unsafe)):
        if condition is not None:
            specs[name] = ("objective", name), condition
    return specs
