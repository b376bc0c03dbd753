"""Tabulate an expression by location and mode, as PRISM text.

Axes: P locations, Q modes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.steps import scope_of
from merap.mdp.model import Ints
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.prism.location_text import cases, predicate
from merap.prism.terms import alternatives, bare
from merap.program.expressions import Constant, Expression, Value, render_constant, tabulate, variables


def table_of(
    combination: Combination, expression: Expression, there: Ints, modes: Sequence[int], default: Value
) -> Constant | str:
    """Compute an expression exactly for each location and mode.

    Args:
        combination: whose attributes the expression reads.
        expression: over attributes, those of the successor and the mode.
        there: int64 [P], the location that a step from each leads to.
        modes: the modes that matter.
        default: the value, if it is undefined everywhere.

    Returns:
        The value, if it is the same everywhere; else a PRISM expression. Where the value is undefined or
        the mode does not matter, the expression has any of its values.
    """
    if not any(variable.name == MODE_VARIABLE for variable in variables(expression)):
        modes = modes[:1]
    here = np.repeat(np.arange(combination.space.num_locations), len(modes))
    mode = np.tile(np.array(modes, dtype=np.int64), combination.space.num_locations)
    values, codes = tabulate(expression, scope_of(combination, here, mode, there[here], mode))
    distinct = list(dict.fromkeys(value for value in values if value is not None)) or [default]
    if len(distinct) == 1:
        return Constant(distinct[0])
    place = {value: index for index, value in enumerate(distinct)}
    index = np.array([0 if value is None else place[value] for value in values])[codes]
    return _text(combination, distinct, index.reshape(-1, len(modes)), modes)


def _text(combination: Combination, values: Sequence[Value], index: Ints, modes: Sequence[int]) -> str:
    """`index` is int64 [P, modes], which of `values`; equal columns are written once."""
    columns, group = np.unique(index, axis=1, return_inverse=True)
    texts = []
    for column in columns.T:
        if isinstance(values[0], bool):
            texts.append(predicate(combination.space, np.array(values)[column]))
        else:
            texts.append(cases(combination.space, [render_constant(value) for value in values], column))
    chain = ""
    for number, text in enumerate(texts[:-1]):
        members = [
            f"{MODE_VARIABLE}={mode}" for mode, of in zip(modes, group.ravel(), strict=True) if of == number
        ]
        chain += f"{bare(alternatives(members))} ? {text} : "
    return f"{chain}{texts[-1]}" if chain else bare(texts[-1])
