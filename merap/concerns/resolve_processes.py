"""Resolve the processes of a concern."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import reduce
from itertools import product

from merap.concerns.document import KeyPath
from merap.concerns.processes import Change, DeclaredProcess
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_processes import ANY, Draw, ProcessSpec, VariableSpec
from merap.errors import InputError
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.program.expressions import Constant, Expression, Kind, Operation, Value, check, fold
from merap.program.form import ConcernName, InitialValues, StateVariable, Update, boolean, integer, whole
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
        parameters: types of the parameters that expressions can read.

    Raises:
        InputError: an expression is wrong, or an action or variable unknown.
    """

    def __init__(
        self,
        context: ResolutionContext,
        concern: ConcernName,
        specs: Mapping[str, ProcessSpec],
        parameters: Mapping[str, Kind],
    ) -> None:
        self._context, self._concern = context, concern
        self._parameters = parameters
        primed = ("attributes", MODE_VARIABLE, "processes")
        self._kinds = {**parameters, **context.variable_kinds(primed=primed, reader=concern)}
        self._templates = [self._template(name, spec) for name, spec in specs.items()]

    def _template(self, name: str, spec: ProcessSpec) -> DeclaredProcess:
        path = (self._concern, "processes", name)
        own = variables_of(name, spec)
        changes = []
        for index, change in enumerate(spec.changes):
            place = (*path, "changes", index)
            where = self._context.compile((*place, "where"), change.where, self._kinds, "bool")
            outcomes = self._outcomes((*place, "set"), change.set, own, self._kinds)
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
        kinds: Mapping[str, Kind],
    ) -> tuple[Update, ...]:
        chances = [
            None
            if draw.probability is None
            else self._context.compile((*path, *draw.path, "probability"), draw.probability, kinds, "number")
            for draw in draws
        ]
        rest: Expression = ONE
        for chance in chances:
            rest = rest if chance is None else Operation("-", (rest, chance))
        return tuple(
            Update(rest if chance is None else chance, self._values(path, draw, own, kinds))
            for chance, draw in zip(chances, draws, strict=True)
        )

    def _values(
        self, path: KeyPath, draw: Draw, own: Mapping[str, StateVariable], kinds: Mapping[str, Kind]
    ) -> dict[str, Expression]:
        place = (*path, *draw.path, *([] if draw.key is None else [draw.key]))
        values = draw.values
        if not isinstance(values, Mapping):
            if len(own) > 1:
                raise self._context.document.error(place, f"give values by name: {', '.join(own)}")
            return {name: self._value(place, values, one, kinds) for name, one in own.items()}
        found = {}
        for name, value in values.items():
            if name not in own:
                raise self._context.document.error(
                    (*place, name), f"unknown variable {name!r} of the process{suggestion(name, own)}"
                )
            found[name] = self._value((*place, name), value, own[name], kinds)
        return found

    def _value(
        self, path: KeyPath, given: float | bool | str, variable: StateVariable, kinds: Mapping[str, Kind]
    ) -> Expression:
        expected: Kind = "bool" if variable.kind == "bool" else "number"
        expression = self._context.compile(path, given, kinds, expected)
        with self._context.document.at(*path):
            check(expression, kinds, expected)
        return expression

    def _initial(
        self, path: KeyPath, spec: ProcessSpec, own: Mapping[str, StateVariable]
    ) -> tuple[InitialValues, ...]:
        kinds = {**self._parameters, **dict.fromkeys(self._context.named_values, "number")}
        if spec.initial is not None:
            outcomes = self._outcomes((*path, "initial"), spec.initial, own, kinds)  # type: ignore[arg-type]
            return tuple(InitialValues(one.probability, one.assignments) for one in outcomes)
        separate = [
            self._outcomes(
                (*path, "variables", name, "initial"),
                one.initial or (),
                {name: own[name]},
                kinds,  # type: ignore[arg-type]
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

    def __call__(self, name: str, known: Mapping[str, Value]) -> tuple[DeclaredProcess, ...]:
        """Return the processes of a configuration.

        Args:
            name: of the configuration.
            known: values of parameters, modes and named values.

        Raises:
            InputError: an expression is undefined, or an initial value or distribution not allowed.
        """
        return tuple(self._closed(template, name, known) for template in self._templates)

    def _closed(self, template: DeclaredProcess, name: str, known: Mapping[str, Value]) -> DeclaredProcess:
        try:
            process = template.mapped(lambda expression: fold(expression, known))
            _check_start(process)
        except InputError as error:
            path = (self._concern, "processes", template.name)
            raise self._context.document.error(path, f"{error.message} ({self._concern} {name})") from error
        return process


def _check_start(process: DeclaredProcess) -> None:
    """Refuse initial values that are missing or out of range, and probabilities that do not sum to 1."""
    total = Fraction(0)
    for start in process.initial:
        assert isinstance(start.probability, Constant)
        total += Fraction(start.probability.value)
        if not 0 <= start.probability.value <= 1:
            raise InputError(f"an initial value has the probability {float(start.probability.value):g}")
        for variable in process.variables:
            if variable.name not in start.values:
                raise InputError(f"an outcome of initial gives {variable.name} no value")
            value = whole(start.values[variable.name], f"the initial value of {variable.name}")
            if not variable.low <= value <= variable.high:
                allowed = f"{variable.low}..{variable.high}"
                raise InputError(f"the initial value of {variable.name} is {value}, allowed is {allowed}")
    if total != 1:
        raise InputError(f"the probabilities of initial sum to {float(total):g}, not 1")
