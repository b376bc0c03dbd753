"""A system under a policy: the induced Markov chain, state by state.

Axes: S states, B branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from merap.mdp.alignment import align_variables
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.prism.engine_text import EngineText, text_of
from merap.prism.lines import CommandLine
from merap.prism.location_tree import location_tree
from merap.prism.program_text import ProgramWriter
from merap.prism.reward_text import rewards_text
from merap.prism.templates import fill_in
from merap.program.expressions import Constant, Expression
from merap.program.form import Program, StateVariable
from merap.program.names import unique_name

# Decimals of a probability. Engines take their nearest double; exact ones see rows that sum to 1.
_DECIMALS = 15


def policy_text(program: Program, chain: TabularMDP, header: Sequence[str]) -> str:
    """Return the text of a chain.

    Args:
        program: whose variables its states have, named as in text.
        chain: one choice for each state, all reachable.
        header: lines of comment.
    """
    writer = ProgramWriter(program)
    structures = {one.name: one for one in rewards_text(program, EngineText(program))}
    names = tuple(one.name for one in program.variables)
    valuations = align_variables(chain, names)
    going = np.flatnonzero(~chain.labels[COMPLETE_LABEL])
    going = going[np.lexsort(valuations[going].T[::-1])]
    complete = writer.text.truth(program.labels[COMPLETE_LABEL])
    sections = {
        "complete": complete,
        "labels": writer.labels(),
        "variables": [line for process in program.processes for line in writer.lines(process)],
        "initial": writer.initial(),
    }
    return fill_in(
        "policy.prism.j2",
        header=header,
        module=unique_name("policy", names),
        start_key=_start_key(program, chain, valuations) if sections["initial"] else [],
        states=_commands(program, chain, valuations, going),
        payments=_payments(writer, program, valuations[going], chain.choice_reward[going]),
        formulas=writer.text.take(),
        shifted=structures.get("objective_shifted"),
        shift=program.rewards["objective"].shift,
        **sections,
    )


def _start_key(program: Program, chain: TabularMDP, valuations: Ints) -> list[str]:
    """The weights of several initial states, which the language has no place for."""
    starts = np.flatnonzero(chain.initial)
    differs = np.ptp(valuations[starts], axis=0) > 0
    own = [(one, place) for place, one in enumerate(program.variables) if differs[place]]
    return [
        f"starts with probability {float(chain.initial[start])!r} at "
        + ", ".join(f"{one.name}={one.text(int(valuations[start, place]))}" for one, place in own)
        for start in starts[np.lexsort(valuations[starts].T[::-1])].tolist()
    ]


def _commands(program: Program, chain: TabularMDP, valuations: Ints, going: Ints) -> list[CommandLine]:
    """Return a command for each state that isn't complete."""
    shares = decimal_shares(chain)
    return [
        CommandLine(
            action="",
            guard=" & ".join(map(_is, program.variables, valuations[state].tolist())),
            updates=_updates(chain, state, shares, program.variables, valuations),
        )
        for state in going.tolist()
    ]


def _payments(
    writer: ProgramWriter, program: Program, valuations: Ints, reward: Floats
) -> list[tuple[str, str]]:
    """Return conditions on the variables beside the location and the flag, and what a step earns there.

    That is a tree over the location; where there is no state, it is the commonest reward.

    Args:
        writer: of the program; it remembers the formulas.
        program: of the states.
        valuations: int64 [N, V], states that are not complete.
        reward: float64 [N].
    """
    own = [place for place, one in enumerate(program.variables) if one.name in program.location]
    rest = [
        place for place, one in enumerate(program.variables) if place not in own and one.name != program.flag
    ]
    groups, group = np.unique(valuations[:, rest], axis=0, return_inverse=True)
    complete, payments = writer.text.truth(program.labels[COMPLETE_LABEL]), []
    for number, values in enumerate(groups.tolist()):
        there = np.flatnonzero(group == number)
        terms = (_is(program.variables[place], value) for place, value in zip(rest, values, strict=True))
        where = " & ".join([*terms, f"!{complete}"])
        places = [program.variables[place] for place in own]
        form = _by_location(places, valuations[there][:, own], reward[there])
        value = text_of(writer.text.formula(f"pay_{number}", form))
        payments.append((where, f"({value})" if value.startswith("-") else value))
    return payments


def _by_location(places: Sequence[StateVariable], valuations: Ints, reward: Floats) -> Expression:
    """Return the reward, by the location variables."""
    values, index = np.unique([_decimal(value) for value in reward.tolist()], return_inverse=True)
    leaves = [Constant(value) for value in values.tolist()]
    if len(leaves) == 1:
        return leaves[0]
    window = np.full([one.size for one in places], np.bincount(index).argmax())
    lows = [one.low for one in places]
    window[tuple((valuations - lows).T)] = index
    return location_tree([one.name for one in places], lows, window.reshape((-1, window.shape[-1])), leaves)


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


def _is(variable: StateVariable, value: int) -> str:
    if variable.kind == "bool":
        return variable.name if value else f"!{variable.name}"
    return f"{variable.name}={value}"


def _updates(
    chain: TabularMDP, state: int, shares: Ints, variables: Sequence[StateVariable], valuations: Ints
) -> str:
    branches = range(chain.choice_to_branch[state], chain.choice_to_branch[state + 1])
    texts = {
        branch: _update(variables, valuations[state], valuations[chain.branch_target[branch]])
        for branch in branches
        if shares[branch]
    }
    if len(texts) == 1:
        return next(iter(texts.values()))
    return " + ".join(f"{_share(shares[branch])} : {text}" for branch, text in texts.items())


def _update(variables: Sequence[StateVariable], before: Ints, after: Ints) -> str:
    changes = [
        f"({one.name}'={_value(one, new)})"
        for one, old, new in zip(variables, before.tolist(), after.tolist(), strict=True)
        if old != new
    ]
    return " & ".join(changes) or "true"


def _value(variable: StateVariable, value: int) -> str:
    if variable.kind == "bool":
        return "true" if value else "false"
    return str(value)


def _share(share: int) -> str:
    """`share` units as a decimal number without zeros at the end."""
    whole, rest = divmod(int(share), 10**_DECIMALS)
    return f"{whole}.{rest:0{_DECIMALS}d}".rstrip("0").rstrip(".")


def _decimal(value: float) -> Fraction:
    """The value to 15 significant digits."""
    return Fraction(f"{value:.15g}")
