"""Resolve the processes of a concern."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import reduce
from itertools import product

from merap.concerns.document import KeyPath
from merap.concerns.expression_names import STEP, ExpressionNames, numbered
from merap.concerns.processes import Change, DeclaredProcess
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_processes import ANY, Draw, ProcessSpec, VariableSpec
from merap.errors import InputError
from merap.program.expressions import Constant, Constants, Expression, Kind, Operation, fold
from merap.program.form import ConcernName, InitialValues, StateVariable, Update, boolean, integer
from merap.program.names import suggestion

ONE = Constant(Fraction(1))


def variables_of(name: str, spec: ProcessSpec) -> dict[str, StateVariable]:
    """Return the variables of a process by name."""
    specs: Mapping[str, VariableSpec] = spec.variables or {name: spec}
    return {own: _variable(own, one) for own, one in specs.items()}


def _variable(name: str, spec: VariableSpec) -> StateVariable:
    if spec.type is not None:
        return boolean(name)
    if spec.range is not None:
        return integer(name, *spec.range)
    assert spec.values is not None
    low, high = Constant(Fraction(0)), Constant(Fraction(len(spec.values) - 1))
    return StateVariable(name, low, high, "named", spec.values)


class ProcessResolver:
    """Makes the processes of a concern from values of its parameters.

    Args:
        context: what the case has in common.
        concern: that owns them.
        specs: by name.

    Raises:
        InputError: an expression is wrong, or an action or variable unknown.
    """

    def __init__(
        self,
        context: ResolutionContext,
        concern: ConcernName,
        specs: Mapping[str, ProcessSpec],
    ) -> None:
        self._context, self._concern = context, concern
        self._names = context.names(concern, primed=STEP)
        self._start_names = context.names(concern, of_state=False)
        self._templates = [self._template(name, spec) for name, spec in specs.items()]

    def _template(self, name: str, spec: ProcessSpec) -> DeclaredProcess:
        path = (self._concern, "processes", name)
        own = variables_of(name, spec)
        changes = []
        for index, change in enumerate(spec.changes):
            place = (*path, "changes", index)
            where = self._context.compile((*place, "where"), change.where, self._names, "bool")
            outcomes = self._outcomes((*place, "set"), change.set, own, self._names)
            if self._concern == "objective" and len(outcomes) > 1:
                raise self._context.document.error(
                    (*place, "set"), "a process of the objective watches: it can't draw, give one value"
                )
            changes.append(Change(self._actions((*place, "action"), change.action), where, outcomes))
        return DeclaredProcess(
            name, self._concern, tuple(own.values()), self._initial(path, spec, own), tuple(changes)
        )

    def _actions(self, path: KeyPath, names: tuple[str, ...] | None) -> frozenset[str] | None:
        if names is None or ANY in names:
            return None
        for name in names:
            if name not in self._context.actions:
                raise self._context.document.error(
                    path, f"unknown action {name!r}{suggestion(name, self._context.actions)}"
                )
        return frozenset(names)

    def _outcomes(
        self,
        path: KeyPath,
        draws: tuple[Draw, ...],
        own: Mapping[str, StateVariable],
        names: ExpressionNames,
    ) -> tuple[Update, ...]:
        chances = [
            None
            if draw.probability is None
            else self._context.compile((*path, *draw.path, "probability"), draw.probability, names, "number")
            for draw in draws
        ]
        rest: Expression = ONE
        for chance in chances:
            rest = rest if chance is None else Operation("-", (rest, chance))
        return tuple(
            Update(rest if chance is None else chance, self._values(path, draw, own, names))
            for chance, draw in zip(chances, draws, strict=True)
        )

    def _values(
        self, path: KeyPath, draw: Draw, own: Mapping[str, StateVariable], names: ExpressionNames
    ) -> dict[str, Expression]:
        place = (*path, *draw.path, *([] if draw.key is None else [draw.key]))
        values = draw.values
        if not isinstance(values, Mapping):
            if len(own) > 1:
                raise self._context.document.error(place, f"give values by name: {', '.join(own)}")
            return {name: self._value(place, values, one, names) for name, one in own.items()}
        found = {}
        for name, value in values.items():
            if name not in own:
                raise self._context.document.error(
                    (*place, name), f"unknown variable {name!r} of the process{suggestion(name, own)}"
                )
            found[name] = self._value((*place, name), value, own[name], names)
        return found

    def _value(
        self, path: KeyPath, given: float | bool | str, variable: StateVariable, names: ExpressionNames
    ) -> Expression:
        expected: Kind = "bool" if variable.kind == "bool" else "number"
        values = numbered(variable.values, variable.low)
        return self._context.compile(path, given, names, expected, values)

    def _initial(
        self, path: KeyPath, spec: ProcessSpec, own: Mapping[str, StateVariable]
    ) -> tuple[InitialValues, ...]:
        names = self._start_names
        if spec.initial is not None:
            outcomes = self._outcomes((*path, "initial"), spec.initial, own, names)
            return tuple(InitialValues(one.probability, one.assignments) for one in outcomes)
        separate = [
            self._outcomes(
                (*path, "variables", name, "initial"),
                one.initial or (),
                {name: own[name]},
                names,
            )
            for name, one in spec.variables.items()
        ]
        return tuple(
            InitialValues(
                reduce(
                    lambda left, right: Operation("*", (left, right)), (one.probability for one in chosen)
                ),
                {name: value for one in chosen for name, value in one.assignments.items()},
            )
            for chosen in product(*separate)
        )

    @property
    def expressions(self) -> list[Expression]:
        """Every expression."""
        found: list[Expression] = []

        def note(expression: Expression) -> Expression:
            found.append(expression)
            return expression

        for template in self._templates:
            template.mapped(note)
        return found

    def __call__(self, name: str, known: Constants) -> tuple[DeclaredProcess, ...]:
        """Return the processes of a configuration.

        Args:
            name: of the configuration.
            known: values of parameters, by their resolved names.

        Raises:
            InputError: an expression is undefined, or an initial value or distribution not allowed.
        """
        return tuple(self._closed(template, name, known) for template in self._templates)

    def _closed(self, template: DeclaredProcess, name: str, known: Constants) -> DeclaredProcess:
        try:
            process = template.mapped(lambda expression: fold(expression, known))
            process.check_start()
        except InputError as error:
            path = (self._concern, "processes", template.name)
            raise self._context.document.error(path, f"{error.message} ({self._concern} {name})") from error
        return process
