"""A system under a policy: the induced Markov chain, state by state.

Axes: S states, B branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Space
from merap.mdp.alignment import align_variables
from merap.mdp.matching import match_rows
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, FLAG_VARIABLE, MODE_VARIABLE
from merap.prism.engine_text import EngineText, text_of
from merap.prism.lines import CommandLine
from merap.prism.location_tree import location_tree
from merap.prism.program_text import ProgramWriter
from merap.prism.reward_text import rewards_text
from merap.prism.templates import fill_in
from merap.program.expressions import Constant
from merap.program.form import Program

# Decimals of a probability. Engines take their nearest double; exact ones see rows that sum to 1.
_DECIMALS = 15


def policy_text(combination: DeclaredCombination, program: Program, chain: TabularMDP, title: str) -> str:
    """Return the text of a chain.

    Args:
        combination: whose locations and modes its states have.
        program: of the combination.
        chain: one choice for each state, all reachable.
        title: a line of comment.
    """
    writer = ProgramWriter(program)
    shifted = rewards_text(program, EngineText(program))[1]
    states, payments = _steps(combination, chain)
    sections = {
        "complete": writer.text.truth(program.labels[COMPLETE_LABEL]),
        "labels": writer.labels(),
        "variables": [line for process in program.processes for line in writer.lines(process)],
        "initial": writer.initial(),
    }
    return fill_in(
        "policy.prism.j2",
        title=title,
        combination=combination,
        start_key=[] if not sections["initial"] else _start_key(combination),
        formulas=writer.text.take(),
        states=states,
        payments=payments,
        shifted=shifted,
        **sections,
    )


def _start_key(combination: DeclaredCombination) -> list[str]:
    """The weights of several initial states, which the language has no place for."""
    space, start = combination.space, combination.objective.start
    return [
        f"starts with probability {float(start[place])!r} at {space.locations[place]}"
        for place in np.flatnonzero(start).tolist()
    ]


def _steps(
    combination: DeclaredCombination, chain: TabularMDP
) -> tuple[list[CommandLine], list[tuple[int, str]]]:
    """Return a command for each state that isn't complete; and by mode the reward of a step in it."""
    space = combination.space
    names = (*space.variable_names, MODE_VARIABLE, FLAG_VARIABLE)
    valuations = align_variables(chain, names)
    shares = decimal_shares(chain)
    going = np.flatnonzero(~chain.labels[COMPLETE_LABEL])
    going = going[np.lexsort(valuations[going].T[::-1])]
    commands = [
        CommandLine(
            action="",
            guard=" & ".join(map(_is, names, valuations[state].tolist())),
            updates=_updates(chain, state, shares, names, valuations),
        )
        for state in going.tolist()
    ]
    place = match_rows(valuations[going][:, : len(space.variable_names)], space.valuations)
    return commands, _payments(space, place, valuations[going][:, -2], chain.choice_reward[going])


def _payments(space: Space, place: Ints, mode: Ints, reward: Floats) -> list[tuple[int, str]]:
    """Return mode and expected reward by location; where there is no state, the commonest reward."""
    payments = []
    for number in np.unique(mode).tolist():
        there = mode == number
        values, index = np.unique([_decimal(value) for value in reward[there].tolist()], return_inverse=True)
        by_location = np.full(space.num_locations, np.bincount(index).argmax())
        by_location[place[there]] = index
        lows, leaves = [0] * len(space.variable_names), [Constant(value) for value in values.tolist()]
        window = by_location.reshape(space.shape or (1, -1))
        payments.append((number, text_of(location_tree(space.variable_names, lows, window, leaves))))
    return payments


def decimal_shares(chain: TabularMDP) -> Ints:
    """int64 [B], probabilities in units of 10^-15, which sum to 10^15 in each row.

    What rounding leaves over goes to the row's likeliest branch.
    """
    unit = 10**_DECIMALS
    shares: Ints = np.rint(chain.branch_prob * unit).astype(np.int64)
    over = unit - np.add.reduceat(shares, chain.choice_to_branch[:-1])
    order = np.lexsort((chain.branch_prob, chain.branch_choice))
    shares[order[chain.choice_to_branch[1:] - 1]] += over
    return shares


def _is(name: str, value: int) -> str:
    if name == FLAG_VARIABLE:
        return name if value else f"!{name}"
    return f"{name}={value}"


def _updates(chain: TabularMDP, state: int, shares: Ints, names: Sequence[str], valuations: Ints) -> str:
    branches = range(chain.choice_to_branch[state], chain.choice_to_branch[state + 1])
    texts = {
        branch: _update(names, valuations[state], valuations[chain.branch_target[branch]])
        for branch in branches
        if shares[branch]
    }
    if len(texts) == 1:
        return next(iter(texts.values()))
    return " + ".join(f"{_share(shares[branch])} : {text}" for branch, text in texts.items())


def _update(names: Sequence[str], before: Ints, after: Ints) -> str:
    changes = [
        f"({name}'={_value(name, new)})"
        for name, old, new in zip(names, before.tolist(), after.tolist(), strict=True)
        if old != new
    ]
    return " & ".join(changes) or "true"


def _value(name: str, value: int) -> str:
    if name == FLAG_VARIABLE:
        return "true" if value else "false"
    return str(value)


def _share(share: int) -> str:
    """`share` units as a decimal number without zeros at the end."""
    whole, rest = divmod(int(share), 10**_DECIMALS)
    return f"{whole}.{rest:0{_DECIMALS}d}".rstrip("0").rstrip(".")


def _decimal(value: float) -> Fraction:
    """The value to 15 significant digits."""
    return Fraction(f"{value:.15g}")
