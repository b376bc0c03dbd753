"""Render a combination as the text that a checker gets."""

from __future__ import annotations

from merap.checker.exchange import ModelText
from merap.concerns.combination import Combination
from merap.prism.rendering import render
from merap.program.exploration import initial_states
from merap.program.states import Encoding


def model_text(combination: Combination) -> ModelText:
    """Render a combination."""
    program = combination.program
    encoding = Encoding(program.variables)
    codes, weights = initial_states(program, encoding)
    return ModelText(
        name=combination.name,
        text=render(combination),
        variables=tuple(variable.name for variable in program.variables),
        starts=encoding.valuations(codes),
        weights=weights,
    )
