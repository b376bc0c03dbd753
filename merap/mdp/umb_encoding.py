"""Encode an MDP or a Markov chain as the entries of a UMB archive."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import chain, count
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.csr import pointers_of
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.umb_index import (
    BOOL,
    BRANCH_REWARD,
    DOUBLE,
    FORMAT_VERSION,
    INITIAL_DISTRIBUTION,
    OWN_GROUP,
    Annotation,
    Index,
    TransitionSystem,
    annotation_entry,
    dump_index,
)
from merap.mdp.umb_valuations import VALUATIONS_ENTRY, pack_valuations

Entries = dict[str, bytes | npt.NDArray[Any]]
Annotations = dict[str, dict[str, Annotation]]

CHAIN_ACTION = "step"
# The format marks initial states by themselves; Storm shows them as a label of this name.
_RESERVED_LABEL = "init"
_IDENTIFIER_LENGTH = 40


def encode(mdp: TabularMDP, reward: str, *, as_chain: bool) -> Entries:
    """Return all entries, the index first.

    Args:
        mdp: a model whose states all have a choice.
        reward: the name of its rewards.
        as_chain: leave out players and actions, which a Markov chain doesn't have.

    Raises:
        ModelError: a state has no choice, or several although `as_chain`; a label is
            called `init`.
    """
    _check_writable(mdp, as_chain=as_chain)
    valuations, packed = pack_valuations(mdp.variable_names, mdp.valuations)
    files = _skeleton_files(mdp) | ({} if as_chain else _action_files(mdp))
    annotations, annotation_files = _annotations(mdp, reward)
    index = Index(
        format_version=FORMAT_VERSION,
        format_revision=0,
        file_data={"tool": "merap"},
        transition_system=_transition_system(mdp, as_chain=as_chain),
        annotations=annotations,
        valuations={"states": valuations},
    )
    return {"index.json": dump_index(index), **files, **annotation_files, VALUATIONS_ENTRY: packed}


def _check_writable(mdp: TabularMDP, *, as_chain: bool) -> None:
    choices = np.diff(mdp.state_to_choice)
    empty = np.flatnonzero(choices == 0)
    if len(empty):
        state = mdp.describe_state(int(empty[0]))
        raise ModelError(f"state {state} has no action; restrict the model to its reachable states first")
    several = np.flatnonzero(choices > 1)
    if as_chain and len(several):
        state = mdp.describe_state(int(several[0]))
        raise ModelError(f"state {state} has {choices[several[0]]} actions, a Markov chain allows 1")
    if _RESERVED_LABEL in mdp.labels:
        raise ModelError(f"label {_RESERVED_LABEL!r} is reserved in UMB; give it another name")


def _transition_system(mdp: TabularMDP, *, as_chain: bool) -> TransitionSystem:
    return TransitionSystem(
        time="discrete",
        num_players=0 if as_chain else 1,
        num_states=mdp.num_states,
        num_initial_states=int(np.count_nonzero(mdp.initial)),
        num_choices=mdp.num_choices,
        num_choice_actions=0 if as_chain else mdp.num_actions,
        num_branches=mdp.num_branches,
        branch_probability_type=DOUBLE,
    )


def _skeleton_files(mdp: TabularMDP) -> Entries:
    return {
        "state-to-choices.bin": _little_endian(mdp.state_to_choice, "u8"),
        "state-is-initial.bin": _bit_set(mdp.initial > 0),
        "choice-to-branches.bin": _little_endian(mdp.choice_to_branch, "u8"),
        "branch-to-target.bin": _little_endian(mdp.branch_target, "u8"),
        "branch-to-probability.bin": _little_endian(mdp.branch_prob, "f8"),
    }


def _action_files(mdp: TabularMDP) -> Entries:
    names = [name.encode() for name in mdp.action_names]
    ends = pointers_of(np.array([len(name) for name in names], dtype=np.int64))
    return {
        "actions/choices/values.bin": _little_endian(mdp.choice_action, "u4"),
        "actions/choices/string-mapping.bin": _little_endian(ends, "u8"),
        "actions/choices/strings.bin": b"".join(names),
    }


def _annotations(mdp: TabularMDP, reward: str) -> tuple[Annotations, Entries]:
    """Encode labels, rewards, and in a group of our own the data that UMB has no place for.

    These are an initial distribution that isn't uniform, and the rewards per branch: choices
    carry their exact mean, and Storm reads only that.
    """
    (reward_id,) = _identifiers([reward])
    of_states, of_choices, of_branches = ("states",), ("choices",), ("branches",)
    annotations: Annotations = {
        "rewards": {reward_id: Annotation(alias=reward, applies_to=of_choices, type=DOUBLE)}
    }
    files: Entries = {
        annotation_entry("rewards", reward_id, "choices"): _little_endian(mdp.choice_reward, "f8")
    }
    for identifier, (name, mask) in zip(_identifiers(mdp.labels), mdp.labels.items(), strict=True):
        annotation = Annotation(alias=name, applies_to=of_states, type=BOOL)
        annotations.setdefault("aps", {})[identifier] = annotation
        files[annotation_entry("aps", identifier, "states")] = _bit_set(mask)
    own = annotations.setdefault(OWN_GROUP, {})
    if len(np.unique(mdp.initial[mdp.initial > 0])) > 1:
        own[INITIAL_DISTRIBUTION] = Annotation(applies_to=of_states, type=DOUBLE)
        files[annotation_entry(OWN_GROUP, INITIAL_DISTRIBUTION, "states")] = _little_endian(mdp.initial, "f8")
    if mdp.branch_reward is not None:
        own[BRANCH_REWARD] = Annotation(alias=reward, applies_to=of_branches, type=DOUBLE)
        files[annotation_entry(OWN_GROUP, BRANCH_REWARD, "branches")] = _little_endian(
            mdp.branch_reward, "f8"
        )
    return annotations, files


def _identifiers(names: Iterable[str]) -> list[str]:
    """Return distinct identifiers of the form that UMB allows, close to the names.

    They are file names in the archive: lower-case, so that they stay apart where case is
    ignored, and short enough for every tar format.
    """
    taken: list[str] = []
    for position, name in enumerate(names):
        plain = re.sub(r"[^0-9a-z_-]", "_", name.lower())[:_IDENTIFIER_LENGTH]
        suffixes = (f"-{number}" for number in count(position))
        candidates = chain([plain] if plain else [], (plain + suffix for suffix in suffixes))
        taken.append(next(candidate for candidate in candidates if candidate not in taken))
    return taken


def _little_endian(array: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    return np.ascontiguousarray(array, dtype=f"<{kind}")


def _bit_set(mask: Bools) -> npt.NDArray[np.uint8]:
    """Pack bits from the least significant one upwards, padded to a multiple of 64."""
    packed = np.packbits(mask, bitorder="little")
    return np.pad(packed, (0, -len(packed) % 8))
