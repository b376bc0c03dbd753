"""Combinations as PRISM text: readable, deterministic, valid for Storm and for PRISM-games."""

from __future__ import annotations

from dataclasses import replace

from merap.concerns.combination import Combination
from merap.concerns.lookup import as_combination
from merap.mdp.model import TabularMDP
from merap.prism.policy_text import policy_text
from merap.prism.program_text import render_program
from merap.prism.text_names import text_names, with_text_names


def render(combination: Combination) -> str:
    """The PRISM model of a combination: a module for each process, grouped by concern.

    The text depends on the combination alone: same input, same bytes.

    Raises:
        InputError: it is no combination.
    """
    as_combination(combination)
    return render_program(combination.program, _header(combination))


def _header(combination: Combination) -> tuple[str, ...]:
    return combination.name, f"sources: {combination.digest}"


def render_policy(combination: Combination, chain: TabularMDP, title: str) -> str:
    """A system under a policy as a Markov chain, with the labels and rewards of its combination.

    Args:
        combination: of the system.
        chain: what the policy makes of the combination's whole model, one choice for each
            state; all of them reachable, in the variables of the program.
        title: one line that says which policy it is.
    """
    assert "\n" not in title, title
    names = replace(text_names(combination.program), actions={}, processes={})
    written = tuple(names.variables.get(name, name) for name in chain.variable_names)
    program = with_text_names(combination.program, names)
    header = (title, _header(combination)[1], *names.header())
    return policy_text(program, replace(chain, variable_names=written), header)
