"""Resolve the conditions of an objective: on states, on steps, and the labels that stand for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from merap.concerns.combination import Condition
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import ExpressionNames
from merap.concerns.location_tables import HERE, mode_in
from merap.concerns.resolution_context import ResolutionContext, as_expression
from merap.concerns.schema_objective import EndSpec, PredicateSpec, RewardSpec, Successor
from merap.errors import InputError
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.program.expressions import Expression, Operation, Variable, all_of
from merap.program.names import suggestion

PRIME = "'"


def resolve_condition(
    context: ResolutionContext, path: KeyPath, spec: PredicateSpec, names: ExpressionNames
) -> Condition:
    """Return a condition, open in the parameters that it reads.

    Args:
        context: what the case has in common.
        path: of the condition.
        spec: as validated.
        names: that its expressions may use.

    Raises:
        InputError: with its place.
    """
    terms: list[Expression] = []
    if spec.at is not None:
        with context.document.at(*path, "at"):
            terms.append(names.located(spec.at))
    if spec.mode is not None:
        modes = [context.mode((*path, "mode"), name) for name in spec.mode]
        terms.append(mode_in(modes, len(context.modes)))
    if isinstance(spec, RewardSpec):
        terms += _successor(context, path, spec, names)
    if spec.where is not None:
        terms.append(context.compile((*path, "where"), spec.where, names, "bool"))
    actions = _actions(context, (*path, "action"), spec.action) if isinstance(spec, EndSpec) else None
    return Condition(actions, all_of(terms))


def _successor(
    context: ResolutionContext, path: KeyPath, spec: RewardSpec, names: ExpressionNames
) -> Iterator[Expression]:
    to = spec.to or Successor(None, {})
    if to.at is not None:
        with context.document.at(*path, "to"):
            yield names.located(to.at, PRIME)
    for name, value in to.values.items():
        place = (*path, "to", name)
        known = [one.removesuffix(PRIME) for one in names.kinds if one.endswith(PRIME) and HERE not in one]
        if name not in known:
            near = suggestion(name, ["at", *known])
            raise context.document.error(place, f"unknown variable {name!r}{near}")
        with context.document.at(*place):
            becomes = Operation("=", (Variable(f"{name}{PRIME}", 1), as_expression(value)))
        yield context.compile(place, becomes, names, "bool")
    if spec.to_mode is not None:
        modes = [context.mode((*path, "to_mode"), name) for name in spec.to_mode]
        yield mode_in(modes, len(context.modes), MODE_VARIABLE + PRIME)


def _actions(
    context: ResolutionContext, path: KeyPath, names: tuple[str, ...] | None
) -> frozenset[str] | None:
    if names is None:
        return None
    for name in names:
        if name not in context.actions:
            raise context.document.error(path, f"unknown action {name!r}{suggestion(name, context.actions)}")
    return frozenset(names)


@dataclass(frozen=True, eq=False, repr=False)
class Labels(Mapping[str, Expression]):
    """Conditions by label, in double quotes; each is resolved when it is first read, and may read others.

    Attributes:
        context: what the case has in common.
        specs: label without quotes -> its place and condition.
    """

    context: ResolutionContext
    specs: Mapping[str, tuple[KeyPath, PredicateSpec]]
    _resolved: dict[str, Expression | None] = field(default_factory=dict)

    def __getitem__(self, quoted: str) -> Expression:
        """Return what a label stands for.

        Raises:
            InputError: with its place: its condition is wrong, or reads itself.
        """
        if quoted not in self:
            raise KeyError(quoted)
        path, spec = self.specs[quoted.strip('"')]
        if quoted not in self._resolved:
            self._resolved[quoted] = None
            context = replace(self.context, labels=self)
            names = context.names("objective")
            self._resolved[quoted] = resolve_condition(context, path, spec, names).where
        found = self._resolved[quoted]
        if found is None:
            raise InputError(f"the label {quoted} is defined by itself")
        return found

    def __contains__(self, quoted: object) -> bool:
        return isinstance(quoted, str) and quoted.startswith('"') and quoted.strip('"') in self.specs

    def __iter__(self) -> Iterator[str]:
        return (f'"{name}"' for name in self.specs)

    def __len__(self) -> int:
        return len(self.specs)
