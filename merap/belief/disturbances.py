"""Outcome probabilities that no capability of the base has: actions that fail more, or less, often.

Built from the capabilities of the base, in two ways: a numeric parameter strictly between 0 and 1 takes
another value, or the intended outcome of every action becomes more or less likely. Both multiply
the odds p / (1 - p) by a factor, which never leaves (0, 1) and treats p and 1 - p alike. What
is certain stays certain: there, slips are what may go wrong.

Axes: U attribute classes, V capability classes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from merap.belief.actions import ActionTable, action_tables
from merap.concerns.case_study import DeclaredCase
from merap.concerns.combination import Capability, DeclaredCombination
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.innate import Innate
from merap.errors import InputError
from merap.program.expressions import Constant, Expression, Operation, number

ALL_OUTCOMES = "all outcomes"
ONE = Fraction(1)
# Probabilities that sum to 1 no closer than this are none.
SUMS_TO_ONE = 1e-9
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Disturbance:
    """A way in which all capabilities may differ from what the base says of them.

    Attributes:
        name: what is different.
        tables: of each action, under it.
    """

    name: str
    tables: tuple[ActionTable, ...]


def disturbances(
    case: DeclaredCase,
    members: Sequence[int],
    representatives: Sequence[Sequence[DeclaredCombination]],
    odds: Sequence[float],
) -> tuple[Disturbance, ...]:
    """None at first, then all that make a difference.

    Args:
        case: the case.
        members: of each capability class, the index of one capability.
        representatives: [U][V], one combination for every attribute and capability class.
        odds: factors on the odds.
    """
    found = [Disturbance("as the base says", action_tables(representatives))]
    for factor in odds:
        exact = Fraction(repr(float(factor)))
        for name in (ALL_OUTCOMES, *_parameters(case, members)):
            tables = _disturbed_tables(case, members, representatives, name, exact)
            if tables is not None and not any(_same(tables, known.tables) for known in found):
                found.append(Disturbance(f"odds of {name} times {factor:g}", tables))
    return tuple(found)


def stacked(found: Sequence[Disturbance]) -> tuple[ActionTable, ...]:
    """One table for each action, with all disturbances side by side in its axis G."""
    return tuple(
        replace(tables[0], prob=np.concatenate([table.prob for table in tables], axis=2))
        for tables in zip(*(one.tables for one in found), strict=True)
    )


def _parameters(case: DeclaredCase, members: Sequence[int]) -> list[str]:
    """Parameters of the capabilities that have a value strictly between 0 and 1 in some class."""
    configurations = case.supports.capability.configurations
    listed = [configurations.values(index) for index in members]
    return [name for name in listed[0] if any(_uncertain(values[name]) for values in listed)]


def _uncertain(value: object) -> bool:
    return isinstance(value, Fraction) and 0 < value < 1


def _disturbed_tables(
    case: DeclaredCase,
    members: Sequence[int],
    representatives: Sequence[Sequence[DeclaredCombination]],
    name: str,
    factor: Fraction,
) -> tuple[ActionTable, ...] | None:
    """None if the capabilities do not allow it: their probabilities no longer sum to 1."""
    try:
        if name == ALL_OUTCOMES:
            capabilities = [_less_certain(one.capability, factor) for one in representatives[0]]
        else:
            capabilities = [_other_value(case, index, name, factor) for index in members]
        tables = action_tables(
            [
                [
                    replace(one, capability=capability)
                    for one, capability in zip(row, capabilities, strict=True)
                ]
                for row in representatives
            ]
        )
    except InputError:
        return None
    return tables if all(_is_sound(table) for table in tables) else None


def _other_value(case: DeclaredCase, index: int, name: str, factor: Fraction) -> Capability:
    support = case.supports.capability
    values = support.configurations.values(index)
    value = values[name]
    if isinstance(value, Fraction) and _uncertain(value):
        values = {**values, name: _likelier(value, factor)}
    return support.resolve(support.name(index), values)


def _likelier(probability: Fraction, factor: Fraction) -> Fraction:
    return factor * probability / (factor * probability + 1 - probability)


def _less_certain(capability: Capability, factor: Fraction) -> Capability:
    return replace(
        capability,
        external=tuple(_external(action, factor) for action in capability.external),
        innate=None if capability.innate is None else _innate(capability.innate, factor),
    )


def _external(action: ExternalAction, factor: Fraction) -> ExternalAction:
    intended, *others = action.outcomes
    total = Operation("+", (Constant(ONE), Operation("*", (Constant(factor - 1), intended.probability))))
    return replace(
        action,
        outcomes=(
            _divided(intended, Operation("*", (Constant(factor), intended.probability)), total),
            *(_divided(outcome, outcome.probability, total) for outcome in others),
        ),
    )


def _divided(outcome: Outcome, weight: Expression, total: Expression) -> Outcome:
    return replace(outcome, probability=Operation("/", (weight, total)))


def _innate(innate: Innate, factor: Fraction) -> Innate:
    """The likeliest next mode is the intended one."""
    actions = []
    for action in innate.actions:
        rows = {}
        for mode, row in action.chances.items():
            intended = max(row, key=lambda target: row[target])
            total = 1 + (factor - 1) * row[intended]
            rows[mode] = {
                target: number((factor if target == intended else 1) * share / total)
                for target, share in row.items()
            }
        actions.append(replace(action, transitions=rows))
    return replace(innate, actions=tuple(actions))


def _is_sound(table: ActionTable) -> bool:
    total = table.prob.sum(axis=-1)
    certain = np.broadcast_to(table.enabled[np.newaxis, :, np.newaxis], total.shape)
    return bool(table.prob.min() >= 0 and np.abs(total - certain).max() < SUMS_TO_ONE)


def _same(tables: Sequence[ActionTable], others: Sequence[ActionTable]) -> bool:
    return all(
        np.allclose(one.prob, other.prob, rtol=0, atol=SAME)
        for one, other in zip(tables, others, strict=True)
    )
