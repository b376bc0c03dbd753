"""A policy as a table of decisions: ranges of values, and the action there.

Axes: S states, V variables, R rows of the table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.families.index import telling_variables
from merap.mdp.matching import row_keys
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.program.form import Program, StateVariable


@dataclass(frozen=True)
class Decisions:
    """The actions of a deterministic policy.

    Attributes:
        variables: V names of variables that differ between states.
        rows: the values of each variable, and last the action; `any` stands for all values.
    """

    variables: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def decisions(program: Program, mdp: TabularMDP, actions: Ints) -> Decisions:
    """Return the action of each state that is not complete; boxes of states with one action are one row.

    Args:
        program: of the model.
        mdp: with the program's variables.
        actions: int64 [S].
    """
    going = ~mdp.labels[COMPLETE_LABEL]
    told = [one for one in telling_variables(program) if one.size > 1]
    low = mdp.valuations[going][:, [mdp.variable_names.index(one.name) for one in told]]
    high, chosen = low, actions[going]
    for column in reversed(range(len(told))):
        low, high, chosen = _merged(low, high, chosen, column)
    order = np.lexsort(low.T[::-1]) if told else np.arange(len(low))
    rows = zip(low[order].tolist(), high[order].tolist(), chosen[order].tolist(), strict=True)
    return Decisions(
        tuple(one.name for one in told),
        tuple(
            (*(_text(*bounds) for bounds in zip(told, first, last, strict=True)), mdp.action_names[action])
            for first, last, action in rows
        ),
    )


def _merged(low: Ints, high: Ints, chosen: Ints, column: int) -> tuple[Ints, Ints, Ints]:
    """Join boxes [R, V] of one action that are neighbours along a variable and equal in all others."""
    others = np.arange(low.shape[1]) != column
    (alike,) = row_keys(np.concatenate([low[:, others], high[:, others], chosen[:, None]], axis=1))
    order = np.lexsort((low[:, column], alike))
    low, high, chosen, alike = low[order], high[order], chosen[order], alike[order]
    begins = np.ones(len(low), dtype=np.bool_)
    begins[1:] = (alike[1:] != alike[:-1]) | (low[1:, column] != high[:-1, column] + 1)
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(low)) - 1
    joined = high[first].copy()
    joined[:, column] = high[last, column]
    return low[first], joined, chosen[first]


def _text(variable: StateVariable, low: int, high: int) -> str:
    if (low, high) == (variable.low, variable.high):
        return "any"
    if low == high or variable.kind != "named":
        ends = dict.fromkeys((variable.text(low), variable.text(high)))
        return "..".join(ends)
    return ", ".join(variable.text(value) for value in range(low, high + 1))
