"""Render a combination as the text that a checker gets."""

from __future__ import annotations

from merap.checker.exchange import ModelText
from merap.concerns.combination import Combination
from merap.mdp.reserved_names import OBJECTIVE_REWARD
from merap.prism.rendering import render
from merap.prism.text_names import text_names
from merap.program.arrays import tabular
from merap.program.exploration import explore, initial_states
from merap.program.states import Encoding


def model_text(combination: Combination) -> ModelText:
    """Render a combination that is sound.

    Where a value is undefined or no whole number, the text says something else, which a checker would not
    notice. Our own exploration does, and says what is wrong in the words of the case.

    Raises:
        ModelError: in a reachable state a guard, a probability, a new value or a reward is undefined, a
            variable leaves its range, probabilities do not sum to 1, or there is no action; names state and
            command.
    """
    program = combination.program
    tabular(program, explore(program), reward=OBJECTIVE_REWARD)
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
