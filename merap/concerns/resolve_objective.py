"""Resolve configurations of the objective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.concerns.combination import Condition, DeclaredObjective, RewardRule
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import STEP, ExpressionNames
from merap.concerns.parameters import Values, constants, held_locations, parameter_name, present_all
from merap.concerns.resolution_context import ResolutionContext, names_in
from merap.concerns.resolve_processes import ProcessResolver, process_entries
from merap.concerns.schema import CaseSpec, EndSpec, PredicateSpec, RewardSpec, StartPoint
from merap.concerns.schema_base import Box, LocationSet
from merap.errors import InputError
from merap.mdp.model import ROW_SUM_TOLERANCE, Bools, Floats
from merap.mdp.reserved_names import GOAL_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import Constants, Expression, fold
from merap.program.names import check_name, suggestion


@dataclass(frozen=True, eq=False, repr=False)
class ConditionTemplate(ShortRepr):
    """A condition before parameters are put in."""

    path: KeyPath
    at: LocationSet | None
    to: LocationSet | None
    modes: Bools | None
    to_modes: Bools | None
    actions: frozenset[str] | None
    where: Expression | None


class ObjectiveResolver:
    """Makes objectives from parameter values; call it with a name and values.

    Raises:
        InputError: an expression is wrong, or a mode or action unknown.
    """

    def __init__(self, context: ResolutionContext, case: CaseSpec) -> None:
        self.context = context
        self.spec = spec = case.objective
        states = context.names("objective")
        steps = context.names("objective", primed=STEP)
        self.rules = tuple(
            (
                self._template(("objective", "rewards", index), rule, steps),
                context.compile(("objective", "rewards", index, "value"), rule.value, steps, "number"),
            )
            for index, rule in enumerate(spec.rewards)
        )
        self.ends_after = self._optional("ends_after", spec.ends_after, states)
        self.ends_in = self._optional("ends_in", spec.ends_in, states)
        self.unsafe = self._optional("unsafe", spec.unsafe, states)
        self.processes = ProcessResolver(context, process_entries(case, "objective"))
        for name in spec.properties:
            with context.document.at("objective", "properties", name):
                check_name(name, "a property")

    def _optional(
        self, key: str, spec: PredicateSpec | None, names: ExpressionNames
    ) -> ConditionTemplate | None:
        return None if spec is None else self._template(("objective", key), spec, names)

    def _template(self, path: KeyPath, spec: PredicateSpec, names: ExpressionNames) -> ConditionTemplate:
        context = self.context
        to, to_mode = (spec.to, spec.to_mode) if isinstance(spec, RewardSpec) else (None, None)
        return ConditionTemplate(
            path=path,
            at=spec.at,
            to=to,
            modes=context.mode_mask((*path, "mode"), spec.mode),
            to_modes=context.mode_mask((*path, "to_mode"), to_mode),
            actions=self._actions((*path, "action"), spec.action) if isinstance(spec, EndSpec) else None,
            where=None
            if spec.where is None
            else context.compile((*path, "where"), spec.where, names, "bool"),
        )

    def _actions(self, path: KeyPath, names: tuple[str, ...] | None) -> frozenset[str] | None:
        if names is None:
            return None
        for name in names:
            if name not in self.context.actions:
                raise self.context.document.error(
                    path, f"unknown action {name!r}{suggestion(name, self.context.actions)}"
                )
        return frozenset(names)

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
        path, points = start or (("objective", "start"), self.spec.start)
        return DeclaredObjective(
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            start=self._start(path, points, values),
            horizon=horizon or self.spec.horizon,
            goal=self.context.mask(held_locations(values, GOAL_LABEL)),
            rules=tuple(
                RewardRule(
                    self._condition(template, name, values, known), self._fold(template, name, value, known)
                )
                for template, value in self.rules
            ),
            ends_after=self._condition_or_none(self.ends_after, name, values, known),
            ends_in=self._condition_or_none(self.ends_in, name, values, known),
            unsafe=self._condition_or_none(self.unsafe, name, values, known),
            properties=dict(self.spec.properties),
            processes=self.processes(name, known),
        )

    def _start(self, path: KeyPath, points: tuple[StartPoint, ...], values: Values) -> Floats:
        if not points:
            return np.ones(1)
        start = np.zeros(self.context.space.num_locations)
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

    def _fold(
        self, template: ConditionTemplate, name: str, expression: Expression, known: Constants
    ) -> Expression:
        try:
            return fold(expression, known)
        except InputError as error:
            raise self.context.document.error(template.path, f"{error.message} (objective {name})") from error

    def _condition_or_none(
        self, template: ConditionTemplate | None, name: str, values: Values, known: Constants
    ) -> Condition | None:
        return None if template is None else self._condition(template, name, values, known)

    def _condition(
        self, template: ConditionTemplate, name: str, values: Values, known: Constants
    ) -> Condition:
        where = template.where
        return Condition(
            at=self._places((*template.path, "at"), template.at, values),
            modes=template.modes,
            actions=template.actions,
            to=self._places((*template.path, "to"), template.to, values),
            to_modes=template.to_modes,
            where=None if where is None else self._fold(template, name, where, known),
        )

    def _places(self, path: KeyPath, refs: LocationSet | None, values: Values) -> Bools | None:
        if refs is None:
            return None
        with self.context.document.at(*path):
            return self.context.mask(self.context.select(refs, self.spec.parameters, values))

    @property
    def templates(self) -> list[ConditionTemplate]:
        """Every condition, those of the rewards first."""
        ends = [self.ends_after, self.ends_in, self.unsafe]
        return [template for template, _ in self.rules] + [end for end in ends if end is not None]

    def names_read(self) -> set[str]:
        """Return the resolved names of the parameters that expressions, locations or the start read."""
        found = [value for _, value in self.rules]
        found += self.processes.expressions
        found += [template.where for template in self.templates if template.where is not None]
        places = [refs for template in self.templates for refs in (template.at, template.to)]
        listed = [ref for refs in places if refs is not None and not isinstance(refs, Box) for ref in refs]
        listed += [point.at for point in self.spec.start]
        held = {parameter_name("objective", ref) for ref in listed if isinstance(ref, str)}
        return names_in(found) | held
