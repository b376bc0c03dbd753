"""Compute how likely a command gives its process the values that were seen, under all hypotheses.

Draws that assign different variables are independent given what was seen, so that their likelihoods
multiply; where a later draw may assign a variable anew, each outcome is followed on its own.

[..] broadcasts to the hypotheses.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from merap.mdp.model import Bools, Floats
from merap.program.expressions import Column, Expression
from merap.program.form import Command, Draw, Update
from merap.program.hypotheses import PointEvaluator

_YES, _ONE, _ZERO = np.array(True), np.array(1.0), np.array(0.0)


def likelihood(
    at: PointEvaluator, command: Command, before: Mapping[str, int], target: Mapping[str, int]
) -> Floats:
    """Return the probability that a command gives the variables of its process some values.

    Args:
        at: of the hypotheses.
        command: that is taken.
        before: all variables before the step.
        target: those of the process after it.

    Returns:
        float64 [..].
    """
    assigned = _assigned(command.draws)
    if any(before[name] != value for name, value in target.items() if name not in assigned):
        return _ZERO
    known = {**before, **{f"{name}'": value for name, value in before.items()}}
    return _drawn(at, command.draws, known, {}, target)


def outcome_likelihood(
    at: PointEvaluator,
    outcome: Update,
    known: Mapping[str, int],
    varying: Mapping[str, Column],
    target: Mapping[str, int],
    names: Collection[str],
) -> Floats:
    """Return the probability of an outcome where it gives some variables the values of the target.

    Args:
        at: of the hypotheses.
        outcome: that may have been drawn.
        known: values before the step and, primed, after earlier draws.
        varying: primed variables that have different values under different hypotheses.
        target: values that were seen.
        names: the variables that are looked at.

    Returns:
        float64 [..]; 0 where a value or the probability is undefined.
    """
    same = _YES
    for name in names:
        if name in outcome.assignments:
            same = same & _becomes(at, outcome.assignments[name], target[name], known, varying)
        elif f"{name}'" in varying:
            same = same & _equals(varying[f"{name}'"], target[name])
        else:
            same = same & np.array(known[f"{name}'"] == target[name])
        if not same.any():
            return _ZERO
    prob, defined = at.value(outcome.probability, known, varying)
    return np.where(same & defined & (prob >= 0) & (prob <= 1), prob, 0.0)


def _drawn(
    at: PointEvaluator,
    draws: Sequence[Draw],
    known: Mapping[str, int],
    varying: Mapping[str, Column],
    target: Mapping[str, int],
) -> Floats:
    """Return the likelihood of what remaining draws give, after the values of earlier ones."""
    if not draws:
        return _ONE
    own, later = _assigned(draws[:1]), _assigned(draws[1:])
    final = own - later
    settled = {**known, **{f"{name}'": target[name] for name in final}}
    open_ = {name: column for name, column in varying.items() if name.removesuffix("'") not in final}
    total = _ZERO
    for one in draws[0]:
        chance = outcome_likelihood(at, one, known, varying, target, final)
        if not own.isdisjoint(later) and chance.any():
            given = {name: value for name, value in one.assignments.items() if name in later}
            pending, defined = _pending(at, given, known, varying)
            rest = _drawn(at, draws[1:], settled, {**open_, **pending}, target)
            chance = np.where(defined, chance * rest, 0.0)
        total = total + chance
    if own.isdisjoint(later) and total.any():
        return total * _drawn(at, draws[1:], settled, open_, target)
    return total


def _assigned(draws: Sequence[Draw]) -> set[str]:
    return {name for draw in draws for one in draw for name in one.assignments}


def _pending(
    at: PointEvaluator,
    given: Mapping[str, Expression],
    known: Mapping[str, int],
    varying: Mapping[str, Column],
) -> tuple[dict[str, Column], Bools]:
    """Return values that a later draw may read or change, and where they are defined."""
    columns, all_defined = {}, _YES
    for name, expression in given.items():
        values, defined = at.whole(expression, known, varying)
        columns[f"{name}'"] = Column.of(values.astype(np.bool_) if name in at.truths else values)
        all_defined = all_defined & defined
    return columns, all_defined


def _becomes(
    at: PointEvaluator,
    value: Expression,
    target: int,
    known: Mapping[str, int],
    varying: Mapping[str, Column],
) -> Bools:
    values, defined = at.whole(value, known, varying)
    same: Bools = defined & (values == target)
    return same


def _equals(column: Column, target: int) -> Bools:
    levels = np.array([value == target for value in column.levels.values], dtype=np.bool_)
    return levels[column.codes]
