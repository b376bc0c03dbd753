"""Reads and writes MDPs in the unified Markov binary format (UMB), the way to and from Storm.

An archive is a tar file of raw little-endian arrays. One that isn't compressed is mapped
into memory and its arrays are used in place, so the file must not be written over in place
while the model lives; replacing it, as `write_umb` does, is fine.

Source: the specification, version 1.0 (https://github.com/pmc-tools/umb, spec.md).
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from merap.errors import InputError, ModelError
from merap.mdp.graph import reachable_states
from merap.mdp.model import Bools, Floats, Ints, TabularMDP, check_pointers, check_range
from merap.mdp.umb_archive import Archive, open_archive, write_archive
from merap.mdp.umb_encoding import CHAIN_ACTION, encode
from merap.mdp.umb_index import (
    BOOL,
    BRANCH_REWARD,
    DOUBLE,
    INITIAL_DISTRIBUTION,
    OWN_GROUP,
    Index,
    annotation_entry,
    parse_index,
)
from merap.mdp.umb_valuations import read_valuations


def read_umb(path: Path, reward: str | None = "objective") -> TabularMDP:
    """Reads an MDP or a Markov chain; the one action of a chain is called `step`.

    State and choice rewards are added up, as are the means of branch rewards. Several
    initial states are equally likely unless a distribution is stored.

    Args:
        path: an archive, plain or compressed by gzip or xz.
        reward: name of the reward structure; None for rewards of 0.

    Returns:
        The model; states keep the archive's numbers.

    Raises:
        InputError: the file isn't a UMB archive, is damaged, or has no such reward.
        ModelError: what it holds isn't an MDP.
    """
    archive = open_archive(path)
    index = parse_index(bytes(archive.content("index.json")), archive.source)
    _check_kind(index, archive.source)
    try:
        return _read_model(archive, index, reward)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def write_umb(
    mdp: TabularMDP,
    path: Path,
    *,
    reward: str = "objective",
    as_chain: bool = False,
    overwrite: bool = False,
) -> None:
    """Writes an archive that Storm and `read_umb` read back; equal models give equal bytes.

    Args:
        mdp: a model whose states all have a choice (see `restrict_to_reachable`).
        path: where to; an uncompressed tar file.
        reward: the name of its rewards there.
        as_chain: write a Markov chain; every state must have exactly one choice.
        overwrite: replace what is there.

    Raises:
        ModelError: a state has no choice, or several although `as_chain`; a label is
            called `init`, which the format reserves.
        OutputError: the file is there already or can't be written.
    """
    write_archive(path, encode(mdp, reward, as_chain=as_chain), overwrite=overwrite)


class _Rows(NamedTuple):
    state_to_choice: Ints
    choice_to_branch: Ints
    branch_target: Ints
    branch_prob: Floats


def _check_kind(index: Index, source: str) -> None:
    system = index.transition_system
    if system.time != "discrete" or system.num_players > 1 or system.num_observations:
        what = f"{system.time} time, {system.num_players} players, {system.num_observations} observations"
        raise InputError(f"neither MDP nor Markov chain in discrete time ({what})", source=source)
    if system.branch_probability_type != DOUBLE:
        raise InputError("probabilities must be of type double", source=source)


def _read_model(archive: Archive, index: Index, reward: str | None) -> TabularMDP:
    rows = _read_rows(archive, index)
    variable_names, valuations = read_valuations(archive, index)
    action_names, choice_action = _read_actions(archive, index)
    choice_reward, branch_reward = _read_rewards(archive, index, reward, rows)
    initial = _read_initial(archive, index)
    return TabularMDP(
        **rows._asdict(),
        choice_action=choice_action,
        choice_reward=choice_reward,
        initial=initial,
        reachable=reachable_states(
            rows.state_to_choice, rows.choice_to_branch, rows.branch_target, initial > 0
        ),
        labels=_read_labels(archive, index),
        valuations=valuations,
        variable_names=variable_names,
        action_names=action_names,
        branch_reward=branch_reward,
    )


def _read_rows(archive: Archive, index: Index) -> _Rows:
    system = index.transition_system
    # Targets first: their size bounds what the index can make us allocate.
    targets = archive.indices("branch-to-target.bin", system.num_branches)
    check_range("branch-to-target.bin", targets, system.num_states)
    return _Rows(
        _read_pointers(archive, "state-to-choices.bin", system.num_states, system.num_choices),
        _read_pointers(archive, "choice-to-branches.bin", system.num_choices, system.num_branches),
        targets,
        archive.array("branch-to-probability.bin", "<f8", system.num_branches),
    )


def _read_pointers(archive: Archive, name: str, rows: int, end: int) -> Ints:
    if name not in archive.entries and rows == end:
        return np.arange(rows + 1)  # by default row i has entry i alone
    pointers = archive.indices(name, rows + 1)
    check_pointers(name, pointers, end)
    return pointers


def _read_actions(archive: Archive, index: Index) -> tuple[tuple[str, ...], Ints]:
    """Names of the A actions, "" for what has none; int64 [C]."""
    system = index.transition_system
    if system.num_choice_actions == 0:
        name = CHAIN_ACTION if system.num_players == 0 else ""
        return (name,), np.zeros(system.num_choices, dtype=np.int64)
    strings = bytes(archive.content("actions/choices/strings.bin"))
    ends = archive.indices("actions/choices/string-mapping.bin", system.num_choice_actions + 1)
    check_pointers("actions/choices/string-mapping.bin", ends, len(strings))
    try:
        names = tuple(strings[start:end].decode() for start, end in pairwise(ends.tolist()))
    except UnicodeDecodeError as error:
        raise InputError(f"an action name isn't UTF-8 ({error})", source=archive.source) from error
    if "actions/choices/values.bin" not in archive.entries:
        return names, np.zeros(system.num_choices, dtype=np.int64)  # by default the first action
    return names, archive.array("actions/choices/values.bin", "<u4", system.num_choices).astype(np.int64)


def _read_initial(archive: Archive, index: Index) -> Floats:
    states = index.transition_system.num_states
    if INITIAL_DISTRIBUTION in index.annotations.get(OWN_GROUP, {}):
        return archive.array(annotation_entry(OWN_GROUP, INITIAL_DISTRIBUTION, "states"), "<f8", states)
    mask = archive.bits("state-is-initial.bin", states)
    if not mask.any():
        raise InputError("no state is initial", source=archive.source)
    uniform: Floats = mask / mask.sum()
    return uniform


def _read_labels(archive: Archive, index: Index) -> dict[str, Bools]:
    labels: dict[str, Bools] = {}
    for identifier, annotation in index.annotations.get("aps", {}).items():
        name = annotation.alias or identifier
        if annotation.type != BOOL or annotation.applies_to != ("states",) or name in labels:
            raise InputError(f"label {name!r} must be one Boolean per state, once", source=archive.source)
        entry = annotation_entry("aps", identifier, "states")
        labels[name] = archive.bits(entry, index.transition_system.num_states)
    return labels


def _read_rewards(
    archive: Archive, index: Index, reward: str | None, rows: _Rows
) -> tuple[Floats, Floats | None]:
    """Expected rewards, float64 [C]; rewards per branch, float64 [B], if the archive has them."""
    if reward is None:
        return np.zeros(index.transition_system.num_choices), None
    parts = _read_reward_parts(archive, index, reward)
    expected = parts.get("choices", np.zeros(index.transition_system.num_choices))
    if "states" in parts:
        expected = expected + np.repeat(parts["states"], np.diff(rows.state_to_choice))
    if "branches" in parts:
        choice = np.repeat(np.arange(len(expected)), np.diff(rows.choice_to_branch))
        mean = np.bincount(choice, rows.branch_prob * parts["branches"], minlength=len(expected))
        return expected + mean, expected[choice] + parts["branches"]
    own = index.annotations.get(OWN_GROUP, {}).get(BRANCH_REWARD)
    if own is None or own.alias != reward:
        return expected, None
    entry = annotation_entry(OWN_GROUP, BRANCH_REWARD, "branches")
    return expected, archive.array(entry, "<f8", len(rows.branch_target))


def _read_reward_parts(archive: Archive, index: Index, reward: str) -> dict[str, Floats]:
    """What a reward structure gives to "states" [S], "choices" [C] and "branches" [B]."""
    system = index.transition_system
    named = {entry.alias or key: (key, entry) for key, entry in index.annotations.get("rewards", {}).items()}
    if reward not in named:
        known = ", ".join(named) or "none"
        raise InputError(f"no reward structure {reward!r}; there are: {known}", source=archive.source)
    identifier, annotation = named[reward]
    sizes = {"states": system.num_states, "choices": system.num_choices, "branches": system.num_branches}
    if annotation.type != DOUBLE or not sizes.keys() >= set(annotation.applies_to):
        raise InputError(
            f"reward structure {reward!r} must give doubles to states, choices or branches",
            source=archive.source,
        )
    return {
        kind: archive.array(annotation_entry("rewards", identifier, kind), "<f8", sizes[kind])
        for kind in annotation.applies_to
    }
