"""Render a combination as the text that a checker gets."""

from __future__ import annotations

from merap.checker.exchange import ModelText
from merap.concerns.combination import Combination
from merap.prism.rendering import render
from merap.prism.text_names import text_names
from merap.program.exploration import initial_states
from merap.program.states import Encoding


def model_text(combination: Combination) -> ModelText:
    """Render a combination."""
    program = combination.program
    written = text_names(program).variables
    encoding = Encoding(program.variables)
    codes, weights = initial_states(program, encoding)
    return ModelText(
        name=combination.name,
        text=render(combination),
        variables=tuple(written.get(one.name, one.name) for one in program.variables),
        starts=encoding.valuations(codes),
        weights=weights,
    )
