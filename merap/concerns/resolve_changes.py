"""Resolve what may become of the variables of a process: one value, or outcomes with probabilities."""

from __future__ import annotations

from collections.abc import Mapping

from merap.concerns.document import KeyPath
from merap.concerns.expression_names import STEP, ExpressionNames, numbered
from merap.concerns.processes import Change, primed
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_processes import ANY, Draw, SetSpec
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.program.expressions import ONE, Expression, Kind, Operation
from merap.program.form import ConcernName, StateVariable, Update
from merap.program.names import suggestion

Variables = Mapping[str, StateVariable]


class ChangeReader:
    """Reads changes and distributions that a concern declares.

    Args:
        context: what the case has in common.
        reader: the concern.
    """

    def __init__(self, context: ResolutionContext, reader: ConcernName) -> None:
        self._context = context
        self._step = context.names(reader, primed=STEP)
        self._start = context.names(reader, of_state=False)

    def change(self, path: KeyPath, spec: SetSpec, own: Variables, actions: frozenset[str] | None) -> Change:
        """Return a change.

        Args:
            path: where it stands.
            spec: what the file says.
            own: the variables of the process by name.
            actions: with which it happens; None: with all.

        Raises:
            InputError: an expression is wrong, or a variable is none of the process.
        """
        where = self._context.compile((*path, "where"), spec.where, self._step, "bool")
        change = Change(actions, where, self._outcomes((*path, "set"), spec.set, own, self._step))
        self._require_order(path, change, own)
        return change

    def _require_order(self, path: KeyPath, change: Change, own: Variables) -> None:
        """Refuse a change that reads what its own process or a later one becomes."""
        names, first = list(self._context.variables), next(iter(own))
        later = set(names[names.index(first) + len(own) :])
        if self._context.variables[first][0] == "environment":
            later.add(MODE_VARIABLE)
        for name in sorted(primed(change)):
            if name in own:
                message = f"a process can't read what it becomes itself: {name}'"
                raise self._context.document.error(path, message)
            if name in later:
                raise self._context.document.error(
                    path,
                    f"this reads what {name} becomes, which is declared later: a change reads only what the "
                    "space and processes declared earlier become",
                )

    def start(self, path: KeyPath, draws: tuple[Draw, ...], own: Variables) -> tuple[Update, ...]:
        """Return a distribution of initial values, which read parameters alone.

        Raises:
            InputError: as `change`.
        """
        return self._outcomes(path, draws, own, self._start)

    def actions(self, path: KeyPath, names: tuple[str, ...] | None) -> frozenset[str] | None:
        """Return the actions that a change names; None: every one.

        Raises:
            InputError: an action is unknown.
        """
        known = self._context.actions
        if names is None or (ANY in names and ANY not in known):
            return None
        for name in names:
            if name not in known:
                raise self._context.document.error(path, f"unknown action {name!r}{suggestion(name, known)}")
        return frozenset(names)

    def _outcomes(
        self, path: KeyPath, draws: tuple[Draw, ...], own: Variables, names: ExpressionNames
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
        self, path: KeyPath, draw: Draw, own: Variables, names: ExpressionNames
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
