"""A system under a policy: the induced Markov chain, state by state.

Axes: S states, B branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.space import Space
from merap.mdp.alignment import align_variables
from merap.mdp.matching import match_rows
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, FLAG_VARIABLE, MODE_VARIABLE
from merap.prism.lines import Command
from merap.prism.location_text import cases
from merap.prism.terms import bare

# Decimals of a probability. Engines take their nearest double; exact ones see rows that sum to 1.
_DECIMALS = 15


@dataclass(frozen=True)
class PolicyText:
    """The content of `policy.prism.j2`.

    Attributes:
        states: one command for each state that isn't complete.
        payments: mode and expected reward of a step in it, by location.
    """

    states: list[Command]
    payments: list[tuple[int, str]]


def policy_text(combination: Combination, chain: TabularMDP) -> PolicyText:
    """The states of a chain that aren't complete, in the order of their valuations.

    Args:
        combination: whose locations and modes they are.
        chain: one choice for each state, all reachable.
    """
    space = combination.space
    names = (*space.variable_names, MODE_VARIABLE, FLAG_VARIABLE)
    valuations = align_variables(chain, names)
    shares = decimal_shares(chain)
    going = np.flatnonzero(~chain.labels[COMPLETE_LABEL])
    going = going[np.lexsort(valuations[going].T[::-1])]
    commands = [
        Command(
            action="",
            guard=" & ".join(map(_is, names, valuations[state].tolist())),
            updates=_updates(chain, state, shares, names, valuations),
        )
        for state in going.tolist()
    ]
    place = match_rows(valuations[going][:, : len(space.variable_names)], space.valuations)
    return PolicyText(commands, _payments(space, place, valuations[going][:, -2], chain.choice_reward[going]))


def _payments(space: Space, place: Ints, mode: Ints, reward: Floats) -> list[tuple[int, str]]:
    """Return mode and expected reward by location; where there is no state, the commonest reward."""
    payments = []
    for number in np.unique(mode).tolist():
        there = mode == number
        texts, index = np.unique([_decimal(value) for value in reward[there].tolist()], return_inverse=True)
        by_location = np.full(space.num_locations, np.bincount(index).argmax())
        by_location[place[there]] = index
        payments.append((number, bare(cases(space, texts.tolist(), by_location))))
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


def _decimal(value: float) -> str:
    """Decimal to 15 significant digits, without an exponent."""
    return f"{Decimal(f'{value:.15g}'):f}"
