"""Read filters of properties, and reduce the values of many states to one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from lark import Tree

from merap.checker.property_file import Node
from merap.checker.solving import Values
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.mdp.model import Ints

SUPPORTED = ("min", "max", "sum", "avg", "count", "forall", "exists", "&", "|", "state", "first")


class FilterParts(NamedTuple):
    """A filter: how to reduce a formula's values, and in which states; None is all of them."""

    operator: str
    formula: Node
    states: Node | None


def filter_parts(tree: Node) -> FilterParts | None:
    """Read `filter(..)`, or braces as in `P=? [F a {s=1}{min}]`; None where there is none.

    Raises:
        UnsupportedPropertyError: the filter shows many values, or finds a state.
    """
    if tree.data == "filter":
        operator, formula, states = tree.children
        if operator not in SUPPORTED:
            raise UnsupportedPropertyError(
                f"filter({operator}, ..) is not supported; expected one of {', '.join(SUPPORTED)}"
            )
        return FilterParts(str(operator), formula, states)
    old = [one for one in tree.children if isinstance(one, Tree) and one.data == "old_filter"]
    if not old:
        return None
    kept = [one for one in tree.children if one not in old]
    states, *extremes = [one.children[0] for one in old]
    operator = str(extremes[0]) if extremes else "state"
    return FilterParts(operator, Tree(tree.data, kept, tree.meta), states)


def filtered(operator: str, values: Values, chosen: Ints, size: int) -> Values:
    """Reduce the values of the chosen states, int64 [I], to one for all states."""
    columns = [column[chosen] for column in (values.value, values.lower, values.upper)]
    match operator:
        case "min" | "max":
            reduced = [getattr(np, operator)(column) for column in columns]
        case "sum" | "avg":
            slack = np.abs(columns[0]).sum() * len(chosen) * np.finfo(np.float64).eps
            sums = [column.sum() + side * slack for column, side in zip(columns, (0, -1, 1), strict=True)]
            reduced = [one / (len(chosen) if operator == "avg" else 1) for one in sums]
        case _:
            reduced = [column[0] for column in columns]
    value, lower, upper = (np.full(size, one) for one in reduced)
    return Values(value, lower, upper, values.exact)
