"""Resolve configurations of the objective."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.concerns.combination import Condition, DeclaredObjective, RewardRule
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import STEP
from merap.concerns.horizon import check_horizon, horizon_of
from merap.concerns.parameters import Values, constants, parameter_name, present_all
from merap.concerns.reserved_words import check_label_name
from merap.concerns.resolution_context import ResolutionContext, names_in
from merap.concerns.resolve_conditions import Labels, resolve_condition
from merap.concerns.resolve_processes import ProcessResolver, process_entries
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_objective import ObjectiveSpec, PredicateSpec, StartPoint
from merap.errors import InputError
from merap.mdp.model import ROW_SUM_TOLERANCE, Floats
from merap.mdp.reserved_names import GOAL_LABEL, UNSAFE_LABEL
from merap.program.expressions import Constants, Expression, fold
from merap.program.names import check_name

START = ("objective", "start")


class ObjectiveResolver:
    """Makes objectives from parameter values; call it with a name and values.

    Raises:
        InputError: an expression is wrong, or a mode, action or label unknown.
    """

    def __init__(self, context: ResolutionContext, case: CaseSpec) -> None:
        self.spec = spec = case.objective
        labels = Labels(context, _label_specs(context, spec))
        self.context = context = replace(context, labels=labels)
        self.labels = dict(labels)  # what is wrong with them is found here
        states, steps = context.names("objective"), context.names("objective", primed=STEP)
        self.rules = tuple(
            RewardRule(
                resolve_condition(context, ("objective", "rewards", index), rule, steps),
                context.compile(("objective", "rewards", index, "value"), rule.value, steps, "number"),
            )
            for index, rule in enumerate(spec.rewards)
        )
        self.ends = {
            key: None
            if condition is None
            else resolve_condition(context, ("objective", key), condition, states)
            for key, condition in (("ends_after", spec.ends_after), ("ends_in", spec.ends_in))
        }
        self.processes = ProcessResolver(context, process_entries(case, "objective"))
        check_horizon(context.document, spec.horizon, spec.parameters)
        for name in spec.properties:
            with context.document.at("objective", "properties", name):
                check_name(name, "a property")

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
        labels = {
            label.strip('"'): self._fold((label.strip('"'),), name, condition, known)
            for label, condition in self.labels.items()
        }
        goal, unsafe = labels.pop(GOAL_LABEL, None), labels.pop(UNSAFE_LABEL, None)
        return DeclaredObjective(
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            start=self._start(path, points, values),
            horizon=horizon or horizon_of(self.context.document, self.spec.horizon, name, values),
            goal=None if goal is None else Condition(where=goal),
            unsafe=None if unsafe is None else Condition(where=unsafe),
            labels=labels,
            rules=tuple(
                RewardRule(
                    self._condition(("rewards", index), name, rule.condition, known),
                    self._fold(("rewards", index, "value"), name, rule.value, known),
                )
                for index, rule in enumerate(self.rules)
            ),
            ends_after=self._end("ends_after", name, known),
            ends_in=self._end("ends_in", name, known),
            properties=dict(self.spec.properties),
            processes=self.processes(name, known),
        )

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

    def _fold(self, path: KeyPath, name: str, expression: Expression, known: Constants) -> Expression:
        try:
            return fold(expression, known)
        except InputError as error:
            message = f"{error.message} (objective {name})"
            raise self.context.document.error(("objective", *path), message) from error

    def _condition(self, path: KeyPath, name: str, condition: Condition, known: Constants) -> Condition:
        where = condition.where
        return condition if where is None else replace(condition, where=self._fold(path, name, where, known))

    def _end(self, key: str, name: str, known: Constants) -> Condition | None:
        end = self.ends[key]
        return None if end is None else self._condition((key,), name, end, known)

    def names_read(self) -> set[str]:
        """Return the resolved names that expressions, locations, the start or the horizon read."""
        conditions = [rule.condition for rule in self.rules]
        conditions += [end for end in self.ends.values() if end is not None]
        found = [one.where for one in conditions if one.where is not None]
        found += [rule.value for rule in self.rules] + [*self.labels.values()] + self.processes.expressions
        held = [point.at for point in self.spec.start] + [self.spec.horizon]
        return names_in(found) | {parameter_name("objective", one) for one in held if isinstance(one, str)}


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
