"""Decode the entries of a UMB archive into an MDP.

Axes as in `model.py`: S states, C choices, B branches, A actions.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from merap.errors import InputError
from merap.mdp.assembly import merge_branches
from merap.mdp.graph import reachable_states
from merap.mdp.model import Floats, Ints, TabularMDP, check_pointers, check_range
from merap.mdp.umb_annotations import read_initial, read_labels, read_rewards
from merap.mdp.umb_archive import Archive
from merap.mdp.umb_encoding import CHAIN_ACTION
from merap.mdp.umb_index import DOUBLE, Index, TransitionSystem
from merap.mdp.umb_valuations import read_valuations

# Entries that only other kinds of models have.
_FOREIGN_ENTRIES = ("state-is-markovian.bin", "state-to-exit-rate.bin")


def decode(archive: Archive, index: Index, reward: str | None, *, numbered: bool = False) -> TabularMDP:
    """Decode an archive; branches of probability 0 are dropped, those to one state added up.

    Args:
        archive: its entries.
        index: its index.
        reward: name of the reward structure; None for rewards of 0.
        numbered: number what has no name of its own, as `read_umb` says.

    Raises:
        InputError: an entry is missing, damaged or contradicts the index; the archive has no
            such reward, or holds neither an MDP nor a Markov chain.
        ModelError: an invariant of `TabularMDP` does not hold.
    """
    system = index.transition_system
    _check_kind(archive, system)
    rows = _read_rows(archive, system)
    _check_players(archive, system, rows)
    if numbered and "states" not in index.valuations:
        variable_names: tuple[str, ...] = ("state",)
        valuations: Ints = np.arange(system.num_states)[:, None]
    else:
        variable_names, valuations = read_valuations(archive, index)
    action_names, choice_action = _read_actions(archive, system, rows.state_to_choice)
    if numbered:
        action_names, choice_action = _numbered(action_names, choice_action, rows.state_to_choice)
    choice_reward, branch_reward = read_rewards(
        archive, index, reward, rows.state_to_choice, rows.choice_to_branch, rows.branch_prob
    )
    initial = read_initial(archive, index)
    choice_to_branch, branch_target, branch_prob, branch_reward = merge_branches(
        rows.choice_to_branch, rows.branch_target, rows.branch_prob, branch_reward, system.num_states
    )
    return TabularMDP(
        state_to_choice=rows.state_to_choice,
        choice_to_branch=choice_to_branch,
        branch_target=branch_target,
        branch_prob=branch_prob,
        choice_action=choice_action,
        choice_reward=choice_reward,
        initial=initial,
        reachable=reachable_states(rows.state_to_choice, choice_to_branch, branch_target, initial > 0),
        labels=read_labels(archive, index),
        valuations=valuations,
        variable_names=variable_names,
        action_names=action_names,
        branch_reward=branch_reward,
    )


class _Rows(NamedTuple):
    """The transitions as they are stored, with `TabularMDP`'s arrays."""

    state_to_choice: Ints
    choice_to_branch: Ints
    branch_target: Ints
    branch_prob: Floats


def _check_kind(archive: Archive, system: TransitionSystem) -> None:
    if system.time != "discrete" or system.num_players > 1 or system.num_observations:
        kind = f"{system.time} time, {system.num_players} players, {system.num_observations} observations"
        raise InputError(f"neither MDP nor Markov chain in discrete time ({kind})", source=archive.source)
    if system.branch_probability_type is None or not system.branch_probability_type.is_real:
        raise InputError("probabilities must be of type double or rational", source=archive.source)
    for name in _FOREIGN_ENTRIES:
        if name in archive.entries:
            raise InputError(f"{name} has no place in a model of discrete time", source=archive.source)
    if system.player_names is not None and len(system.player_names) != system.num_players:
        raise InputError(
            f"{len(system.player_names)} player names, but {system.num_players} players",
            source=archive.source,
        )


def _check_players(archive: Archive, system: TransitionSystem, rows: _Rows) -> None:
    """Refuse states of players that do not exist, and several choices where there is no player."""
    if "state-to-player.bin" in archive.entries:
        player = archive.numbers("state-to-player.bin", system.num_states)
        check_range("state-to-player.bin", player, system.num_players)
    most = int(np.diff(rows.state_to_choice).max())
    if system.num_players == 0 and most > 1:
        raise InputError(f"a state has {most} choices, but there is no player", source=archive.source)


def _read_rows(archive: Archive, system: TransitionSystem) -> _Rows:
    # Read in this order, the size of an entry bounds all that the index can make us allocate.
    branches = system.num_branches
    several = system.num_states > 1  # with one state, targets may be left out
    target = archive.indices("branch-to-target.bin", branches) if several else None
    prob = archive.reals("branch-to-probability.bin", system.branch_probability_type or DOUBLE, branches)
    if target is None:
        target = archive.indices("branch-to-target.bin", branches, optional=True)
    check_range("branch-to-target.bin", target, system.num_states)
    choice_to_branch = _read_pointers(archive, "choice-to-branches.bin", system.num_choices, branches)
    state_to_choice = _read_pointers(archive, "state-to-choices.bin", system.num_states, system.num_choices)
    return _Rows(state_to_choice, choice_to_branch, target, prob)


def _read_pointers(archive: Archive, name: str, rows: int, end: int) -> Ints:
    if rows == end and not archive.has(name):
        return np.arange(rows + 1)  # by default row i has entry i alone
    pointers = archive.indices(name, rows + 1)
    check_pointers(name, pointers, end)
    return pointers


def _read_actions(
    archive: Archive, system: TransitionSystem, state_to_choice: Ints
) -> tuple[tuple[str, ...], Ints]:
    """Read the names of the A actions, "" for one without a name, and int64 [C].

    Actions without a table of names are called `a0`, `a1`, ... by number, as Storm calls them.
    Without actions, the choices of each state are numbered so, unless no state has several.
    """
    # The actions of branches play no part, but must be sound as well.
    _read_action_table(archive, "branch", system.num_branch_actions, system.num_branches)
    names, number = _read_action_table(archive, "choice", system.num_choice_actions, system.num_choices)
    if system.num_choice_actions == 0:
        return _number_choices(state_to_choice, is_chain=system.num_players == 0)
    if names is not None:
        return names, number
    used, action = np.unique(number, return_inverse=True)
    return tuple(f"a{name}" for name in used.tolist()), action


def _read_action_table(
    archive: Archive, kind: Literal["choice", "branch"], num_actions: int, size: int
) -> tuple[tuple[str, ...] | None, Ints]:
    """Read the names of actions, if there are any, and the action of each choice or branch, int64 [size]."""
    folder = "actions/choices" if kind == "choice" else "actions/branches"
    values, mapping, strings = f"{folder}/values.bin", f"{folder}/string-mapping.bin", f"{folder}/strings.bin"
    present = [name for name in (values, mapping, strings) if name in archive.entries]
    if num_actions == 0 and present:
        raise InputError(f"{present[0]} is there, but #{kind}-actions is 0", source=archive.source)
    if strings in present and mapping not in present:
        raise InputError(f"{strings} is there without {mapping}", source=archive.source)
    number = archive.numbers(values, size, optional=True)
    if num_actions:
        check_range(f"{kind}_action", number, num_actions)
    if not archive.has(mapping):
        return None, number
    content = bytes(archive.content(strings))
    ends = archive.indices(mapping, num_actions + 1)
    check_pointers(mapping, ends, len(content))
    try:
        return tuple(content[start:end].decode() for start, end in pairwise(ends.tolist())), number
    except UnicodeDecodeError as error:
        raise InputError(f"an action name isn't UTF-8 ({error})", source=archive.source) from error


def _numbered(names: tuple[str, ...], action: Ints, state_to_choice: Ints) -> tuple[tuple[str, ...], Ints]:
    """Number the choices of one action in a state from the second on."""
    state = np.repeat(np.arange(len(state_to_choice) - 1), np.diff(state_to_choice))
    key = state * len(names) + action
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    place = np.arange(len(key)) - np.repeat(starts, np.diff(starts, append=len(key)))
    repeat = np.empty_like(place)
    repeat[order] = place
    used, number = np.unique(np.stack((repeat, action)), axis=1, return_inverse=True)
    found = [names[of] + (f"#{times + 1}" if times else "") for times, of in used.T.tolist()]
    return tuple(found), number.ravel()


def _number_choices(state_to_choice: Ints, *, is_chain: bool) -> tuple[tuple[str, ...], Ints]:
    counts = np.diff(state_to_choice)
    number: Ints = np.arange(state_to_choice[-1]) - np.repeat(state_to_choice[:-1], counts)
    most = int(counts.max())
    if most <= 1:
        return (CHAIN_ACTION if is_chain else "",), number
    return tuple(f"a{name}" for name in range(most)), number
