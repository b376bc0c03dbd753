"""Read initial states, labels and rewards from a UMB archive.

Axes as in `model.py`: S states, C choices, B branches.
"""

from __future__ import annotations

import numpy as np

from merap.errors import InputError
from merap.mdp.assembly import sum_by
from merap.mdp.model import Bools, Floats, Ints
from merap.mdp.umb_archive import Archive
from merap.mdp.umb_index import (
    BOOL,
    BRANCH_REWARD,
    INITIAL_DISTRIBUTION,
    OWN_GROUP,
    Index,
    annotation_entry,
)


def read_initial(archive: Archive, index: Index) -> Floats:
    """Read the initial distribution, float64 [S]; uniform over the initial states unless one is stored.

    Raises:
        InputError: no state is initial, or their number is not that of the index.
    """
    system = index.transition_system
    if system.num_initial_states == 0 and not archive.has("state-is-initial.bin"):
        raise InputError("no state is initial", source=archive.source)
    mask = archive.bits("state-is-initial.bin", system.num_states)
    count = int(np.count_nonzero(mask))
    if count == 0:
        raise InputError("no state is initial", source=archive.source)
    if count != system.num_initial_states:
        raise InputError(
            f"#initial-states is {system.num_initial_states}, but state-is-initial.bin marks {count}",
            source=archive.source,
        )
    stored = index.annotations.get(OWN_GROUP, {}).get(INITIAL_DISTRIBUTION)
    if stored is None:
        uniform: Floats = mask / count
        return uniform
    entry = annotation_entry(OWN_GROUP, INITIAL_DISTRIBUTION, "states")
    initial = archive.reals(entry, stored.type, system.num_states)
    if not np.array_equal(initial > 0, mask):
        raise InputError(f"{entry} and state-is-initial.bin differ", source=archive.source)
    return initial


def read_labels(archive: Archive, index: Index) -> dict[str, Bools]:
    """Read the labels, name -> bool [S]; where a label's values are left out, it holds nowhere.

    Raises:
        InputError: one is not a Boolean for each state, or two have one name.
    """
    states = index.transition_system.num_states
    labels: dict[str, Bools] = {}
    for identifier, annotation in index.annotations.get("aps", {}).items():
        name = annotation.name(identifier)
        if annotation.type != BOOL or annotation.applies_to != ("states",) or name in labels:
            raise InputError(f"label {name!r} must be one Boolean per state, once", source=archive.source)
        labels[name] = archive.bits(annotation_entry("aps", identifier, "states"), states, optional=True)
    return labels


def read_rewards(
    archive: Archive,
    index: Index,
    reward: str | None,
    state_to_choice: Ints,
    choice_to_branch: Ints,
    branch_prob: Floats,
) -> tuple[Floats, Floats | None]:
    """Read a reward structure; where values are left out, they are 0.

    Args:
        archive: the entries.
        index: their index.
        reward: the structure's name; None for rewards of 0.
        state_to_choice: int64 [S + 1], pointers.
        choice_to_branch: int64 [C + 1], pointers.
        branch_prob: float64 [B].

    Returns:
        Expected rewards, float64 [C]; r(s, a, s'), float64 [B], if rewards of branches are stored.

    Raises:
        InputError: there is no such structure, or its values are no real numbers.
    """
    num_choices = len(choice_to_branch) - 1
    if reward is None:
        return np.zeros(num_choices), None
    parts = _read_reward_parts(archive, index, reward)
    expected = parts.get("choices", np.zeros(num_choices))
    if "states" in parts:
        expected = expected + np.repeat(parts["states"], np.diff(state_to_choice))
    if "branches" in parts:
        choice = np.repeat(np.arange(num_choices), np.diff(choice_to_branch))  # [B]
        mean = sum_by(choice, branch_prob * parts["branches"], num_choices)
        return expected + mean, expected[choice] + parts["branches"]
    own = index.annotations.get(OWN_GROUP, {}).get(BRANCH_REWARD)
    if own is None or own.alias != reward:
        return expected, None
    entry = annotation_entry(OWN_GROUP, BRANCH_REWARD, "branches")
    return expected, archive.reals(entry, own.type, len(branch_prob))


def _read_reward_parts(archive: Archive, index: Index, reward: str) -> dict[str, Floats]:
    """Read the rewards of a structure for "states" [S], "choices" [C] and "branches" [B]."""
    system = index.transition_system
    annotations = index.annotations.get("rewards", {})
    names = [annotation.name(identifier) for identifier, annotation in annotations.items()]
    if names.count(reward) != 1:
        problem = "two reward structures" if reward in names else "no reward structure"
        known = ", ".join(names) or "none"
        raise InputError(f"{problem} {reward!r}; there are: {known}", source=archive.source)
    identifier = list(annotations)[names.index(reward)]
    annotation = annotations[identifier]
    sizes = {"states": system.num_states, "choices": system.num_choices, "branches": system.num_branches}
    if not (annotation.type.is_real and sizes.keys() >= set(annotation.applies_to)):
        raise InputError(
            f"reward structure {reward!r} must give doubles or rationals to states, choices or branches",
            source=archive.source,
        )
    return {
        kind: archive.reals(
            annotation_entry("rewards", identifier, kind), annotation.type, sizes[kind], optional=True
        )
        for kind in annotation.applies_to
    }
