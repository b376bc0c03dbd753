"""Define an explicit Markov decision process in compressed sparse rows (CSR), as UMB has it.

Axes: S states, C choices (a state and one of its actions), B branches (a choice and one
of its successors), A action names, V variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from merap.errors import ModelError, quoted_if_odd
from merap.mdp.matching import first_repeat, row_keys
from merap.mdp.short_repr import ShortRepr

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

ROW_SUM_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class TabularMDP(ShortRepr):
    """A finite MDP (Puterman 2005, section 2.1); arrays are read-only.

    The choices of state s are `state_to_choice[s]:state_to_choice[s + 1]`, the branches of
    choice c are `choice_to_branch[c]:choice_to_branch[c + 1]`. Every reachable state has a
    choice; rows of unreachable states may be empty.

    Attributes:
        state_to_choice: int64 [S + 1], pointers.
        choice_to_branch: int64 [C + 1], pointers.
        branch_target: int64 [B], successor state.
        branch_prob: float64 [B], in (0, 1], sums to 1 over a choice.
        choice_action: int64 [C], index into `action_names`, distinct within a state.
        choice_reward: float64 [C], expected immediate reward.
        initial: float64 [S], a distribution.
        reachable: bool [S], reachable from `initial`; no branch leads from there to elsewhere.
        labels: name -> bool [S].
        valuations: int64 [S, V], distinct rows.
        variable_names: V names.
        action_names: A names.
        branch_reward: float64 [B] or None; its expectation is `choice_reward`.

    Raises:
        ModelError: an invariant does not hold; names state and action.
    """

    state_to_choice: Ints
    choice_to_branch: Ints
    branch_target: Ints
    branch_prob: Floats
    choice_action: Ints
    choice_reward: Floats
    initial: Floats
    reachable: Bools
    labels: Mapping[str, Bools]
    valuations: Ints
    variable_names: tuple[str, ...]
    action_names: tuple[str, ...]
    branch_reward: Floats | None = field(default=None)

    def __post_init__(self) -> None:
        for name, dtype in _DTYPES.items():
            self._freeze(name, dtype)
        if self.branch_reward is not None:
            self._freeze("branch_reward", np.float64)
        labels = {name: _read_only(mask, np.bool_) for name, mask in self.labels.items()}
        object.__setattr__(self, "labels", MappingProxyType(labels))
        _check_names(self)
        _check_shapes(self)
        _check_structure(self)
        _check_states(self)
        _check_probabilities(self)
        _check_rewards(self)

    def _freeze(self, name: str, dtype: type[np.generic]) -> None:
        object.__setattr__(self, name, _read_only(getattr(self, name), dtype))

    def __getstate__(self) -> dict[str, Any]:
        own = {declared.name: getattr(self, declared.name) for declared in fields(self)}
        return {**own, "labels": dict(self.labels)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, labels=MappingProxyType(state["labels"]))
        for array in (*state.values(), *self.labels.values()):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False

    @property
    def num_states(self) -> int:
        """The number of states, S."""
        return len(self.state_to_choice) - 1

    @property
    def num_choices(self) -> int:
        """The number of choices, C."""
        return len(self.choice_to_branch) - 1

    @property
    def num_branches(self) -> int:
        """The number of branches, B."""
        return len(self.branch_target)

    @property
    def num_actions(self) -> int:
        """The number of actions, A."""
        return len(self.action_names)

    @cached_property
    def choice_state(self) -> Ints:
        """int64 [C], the state each choice belongs to."""
        return np.repeat(np.arange(self.num_states), np.diff(self.state_to_choice))

    @cached_property
    def branch_choice(self) -> Ints:
        """int64 [B], the choice each branch belongs to."""
        return np.repeat(np.arange(self.num_choices), np.diff(self.choice_to_branch))

    @cached_property
    def choice_table(self) -> Ints:
        """int64 [S, A], the choice of each state and action; -1 where there is none."""
        table = np.full((self.num_states, self.num_actions), -1)
        table[self.choice_state, self.choice_action] = np.arange(self.num_choices)
        return table

    @cached_property
    def mean_branch_reward(self) -> Floats:
        """float64 [B], r(s, a, s') where it is known, else the expected reward of the choice."""
        return self.choice_reward[self.branch_choice] if self.branch_reward is None else self.branch_reward

    @cached_property
    def enabled(self) -> Bools:
        """bool [S, A], where an action has a choice."""
        mask = np.zeros((self.num_states, self.num_actions), dtype=np.bool_)
        mask[self.choice_state, self.choice_action] = True
        return mask

    @cached_property
    def transitions(self) -> csr_array:
        """float64 [C, S] sparse, the successor distribution of each choice."""
        return csr_array(
            (self.branch_prob, self.branch_target, self.choice_to_branch),
            shape=(self.num_choices, self.num_states),
        )

    def describe_state(self, state: int) -> str:
        """Describe a state by its valuation, for messages: `(row=3, col=4)`."""
        pairs = zip(self.variable_names, self.valuations[state], strict=True)
        return "(" + ", ".join(f"{quoted_if_odd(name)}={value}" for name, value in pairs) + ")"

    def describe_choice(self, choice: int) -> str:
        """Describe a choice by state and action, for messages: `(row=3, col=4), action up`."""
        state = self.describe_state(int(self.choice_state[choice]))
        action = quoted_if_odd(self.action_names[self.choice_action[choice]])
        return f"{state}, action {action or '(unnamed)'}"


_DTYPES: dict[str, type[np.generic]] = {
    "state_to_choice": np.int64,
    "choice_to_branch": np.int64,
    "branch_target": np.int64,
    "branch_prob": np.float64,
    "choice_action": np.int64,
    "choice_reward": np.float64,
    "initial": np.float64,
    "reachable": np.bool_,
    "valuations": np.int64,
}


def _read_only(array: npt.ArrayLike, dtype: type[np.generic]) -> npt.NDArray[Any]:
    view = np.asarray(array, dtype=dtype).view()
    view.flags.writeable = False
    return view


def _check_names(mdp: TabularMDP) -> None:
    for kind, names in (("variable", mdp.variable_names), ("action", mdp.action_names)):
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ModelError(f"{kind} name {name!r} is there twice")


def _check_shapes(mdp: TabularMDP) -> None:
    states, choices, branches = mdp.num_states, mdp.num_choices, mdp.num_branches
    expected: dict[str, tuple[int, ...]] = {
        "branch_prob": (branches,),
        "choice_action": (choices,),
        "choice_reward": (choices,),
        "initial": (states,),
        "reachable": (states,),
        "valuations": (states, len(mdp.variable_names)),
    }
    for name, shape in expected.items():
        if getattr(mdp, name).shape != shape:
            raise ModelError(f"{name} has shape {getattr(mdp, name).shape}, not {shape}")
    if mdp.branch_reward is not None and mdp.branch_reward.shape != (branches,):
        raise ModelError(f"branch_reward has shape {mdp.branch_reward.shape}, not ({branches},)")
    for name, mask in mdp.labels.items():
        if mask.shape != (states,):
            raise ModelError(f"label {name!r} has shape {mask.shape}, not ({states},)")


def _check_structure(mdp: TabularMDP) -> None:
    check_pointers("state_to_choice", mdp.state_to_choice, mdp.num_choices)
    check_pointers("choice_to_branch", mdp.choice_to_branch, mdp.num_branches)
    check_range("branch_target", mdp.branch_target, mdp.num_states)
    check_range("choice_action", mdp.choice_action, mdp.num_actions)
    empty = np.flatnonzero(mdp.reachable & (np.diff(mdp.state_to_choice) == 0))
    if len(empty):
        raise ModelError(f"state {mdp.describe_state(int(empty[0]))} has no action")
    barren = np.flatnonzero(np.diff(mdp.choice_to_branch) == 0)
    if len(barren):
        raise ModelError(f"{mdp.describe_choice(int(barren[0]))} has no successor")
    repeated = first_repeat(mdp.choice_state * mdp.num_actions + mdp.choice_action)
    if repeated is not None:
        raise ModelError(f"{mdp.describe_choice(repeated[0])} is there twice")
    repeated = first_repeat(mdp.branch_choice * mdp.num_states + mdp.branch_target)
    if repeated is not None:
        choice = mdp.describe_choice(int(mdp.branch_choice[repeated[0]]))
        successor = mdp.describe_state(int(mdp.branch_target[repeated[0]]))
        raise ModelError(f"{choice} has successor {successor} twice")


def _check_states(mdp: TabularMDP) -> None:
    repeated = first_repeat(row_keys(mdp.valuations)[0])
    if repeated is not None:
        raise ModelError(f"states {repeated[0]} and {repeated[1]} are both {mdp.describe_state(repeated[0])}")
    source_reachable = mdp.reachable[mdp.choice_state][mdp.branch_choice]
    escaping = np.flatnonzero(source_reachable & ~mdp.reachable[mdp.branch_target])
    if len(escaping):
        choice = mdp.describe_choice(int(mdp.branch_choice[escaping[0]]))
        successor = mdp.describe_state(int(mdp.branch_target[escaping[0]]))
        raise ModelError(f"{choice} leads to {successor}, which is marked unreachable")


def check_pointers(name: str, pointers: Ints, end: int) -> None:
    """Raise ModelError unless int64 `pointers` rise from 0 to `end`."""
    if len(pointers) == 0 or pointers[0] != 0 or pointers[-1] != end or np.any(np.diff(pointers) < 0):
        raise ModelError(f"{name} must rise from 0 to {end}")


def check_range(name: str, indices: Ints, size: int) -> None:
    """Raise ModelError unless int64 `indices` are in 0..size - 1."""
    if len(indices) and (indices.min() < 0 or indices.max() >= size):
        raise ModelError(f"{name} holds {indices.min()}..{indices.max()}, allowed is 0..{size - 1}")


def _check_probabilities(mdp: TabularMDP) -> None:
    bad = np.flatnonzero(~((mdp.branch_prob > 0) & (mdp.branch_prob <= 1 + ROW_SUM_TOLERANCE)))
    if len(bad):
        choice = mdp.describe_choice(int(mdp.branch_choice[bad[0]]))
        raise ModelError(f"{choice} has a probability of {mdp.branch_prob[bad[0]]}, not in (0, 1]")
    sums = np.bincount(mdp.branch_choice, mdp.branch_prob, minlength=mdp.num_choices)
    off = np.flatnonzero(np.abs(sums - 1) > ROW_SUM_TOLERANCE)
    if len(off):
        raise ModelError(f"{mdp.describe_choice(int(off[0]))}: probabilities sum to {sums[off[0]]}, not 1")
    if not (np.all(mdp.initial >= 0) and abs(mdp.initial.sum() - 1) <= ROW_SUM_TOLERANCE):
        raise ModelError(f"the initial distribution sums to {mdp.initial.sum()}, not 1")
    hidden = np.flatnonzero((mdp.initial > 0) & ~mdp.reachable)
    if len(hidden):
        raise ModelError(f"initial state {mdp.describe_state(int(hidden[0]))} is marked unreachable")


def _check_rewards(mdp: TabularMDP) -> None:
    bad = np.flatnonzero(~np.isfinite(mdp.choice_reward))
    if len(bad):
        raise ModelError(f"{mdp.describe_choice(int(bad[0]))} has reward {mdp.choice_reward[bad[0]]}")
    if mdp.branch_reward is None:
        return
    mean = np.bincount(mdp.branch_choice, mdp.branch_prob * mdp.branch_reward, minlength=mdp.num_choices)
    off = np.flatnonzero(~np.isclose(mean, mdp.choice_reward, rtol=1e-9, atol=1e-9))
    if len(off):
        raise ModelError(
            f"{mdp.describe_choice(int(off[0]))}: branch rewards average {mean[off[0]]}, "
            f"choice_reward is {mdp.choice_reward[off[0]]}"
        )
