"""Count the initial states of a program that are given by a condition, under many hypotheses.

Axes: N states; [..] broadcasts to the hypotheses.
"""

from __future__ import annotations

import numpy as np

from merap.errors import ModelError
from merap.mdp.model import Ints
from merap.program.expressions import Column, evaluate_where_defined, variables
from merap.program.form import Program
from merap.program.hypotheses import Hypotheses
from merap.program.states import Encoding, States

# Conditions that are evaluated at once, and altogether at most.
CHUNK, MAX_CONDITIONS = 1_000_000, 1_000_000_000


def count_initial_states(program: Program, hypotheses: Hypotheses) -> Ints:
    """Return in how many valuations the condition on initial states holds: int64 [..].

    Raises:
        InputError: the range of a variable depends on a parameter.
        ModelError: there are too many valuations and hypotheses.
    """
    assert program.initial_predicate is not None
    encoding = Encoding(program.variables)
    names = {one.name for one in variables(program.initial_predicate)}
    read = {name: hypotheses[name] for name in names if name not in encoding.by_name}
    shape = np.broadcast_shapes(*(column.codes.shape for column in read.values()))
    width = int(np.prod(shape))
    if encoding.size * width > MAX_CONDITIONS:
        raise ModelError(
            f"{program.name}: initial states are given by a condition, which would have to be tried for "
            f"{float(encoding.size):.3g} valuations under {width} hypotheses"
        )
    count = np.zeros(shape, dtype=np.int64)
    size = max(CHUNK // width, 1)
    for first in range(0, encoding.size, size):
        states = States(encoding, np.arange(first, min(first + size, encoding.size)))
        along = (-1, *(1 for _ in shape))
        own = {
            name: Column(states[name].levels, states[name].codes.reshape(along))
            for name in names
            if name in encoding.by_name
        }
        holds, defined = evaluate_where_defined(program.initial_predicate, {**own, **read})
        true = np.broadcast_to(holds & defined, (len(states.codes), *shape))
        count += true.sum(axis=0)
    return count
