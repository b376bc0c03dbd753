"""Small MDPs made by hand, each with its source, and ways to make others."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import product

import numpy as np

from merap.mdp.graph import reachable_states
from merap.mdp.model import Ints, TabularMDP

State = tuple[int, ...]
# State -> action -> (reward, successor -> probability).
Choices = Mapping[State, Mapping[str, tuple[float, Mapping[State, float]]]]


def make_mdp(
    choices: Choices,
    *,
    variables: tuple[str, ...] = ("s",),
    actions: tuple[str, ...] | None = None,
    initial: Mapping[State, float] | None = None,
    labels: Mapping[str, Collection[State]] | None = None,
) -> TabularMDP:
    """States, choices and branches in the order in which they are written."""
    states = list(choices)
    number = {state: index for index, state in enumerate(states)}
    names = actions or tuple(dict.fromkeys(name for row in choices.values() for name in row))
    flat = [(names.index(name), *choice) for row in choices.values() for name, choice in row.items()]
    targets = [number[target] for _, _, branches in flat for target in branches]
    state_to_choice = np.cumsum([0, *(len(row) for row in choices.values())])
    choice_to_branch = np.cumsum([0, *(len(branches) for _, _, branches in flat)])
    weights = initial or {states[0]: 1.0}
    start = np.array([weights.get(state, 0.0) for state in states])
    return TabularMDP(
        state_to_choice=state_to_choice,
        choice_to_branch=choice_to_branch,
        branch_target=np.array(targets, dtype=np.int64),
        branch_prob=np.array([prob for _, _, branches in flat for prob in branches.values()]),
        choice_action=np.array([action for action, _, _ in flat], dtype=np.int64),
        choice_reward=np.array([reward for _, reward, _ in flat], dtype=np.float64),
        initial=start,
        reachable=reachable_states(
            state_to_choice, choice_to_branch, np.array(targets, dtype=np.int64), start > 0
        ),
        labels={
            name: np.array([state in where for state in states]) for name, where in (labels or {}).items()
        },
        valuations=np.array(states, dtype=np.int64).reshape(len(states), len(variables)),
        variable_names=variables,
        action_names=names,
    )


def puterman_two_states() -> TabularMDP:
    """Puterman 2005, Section 3.1 (Figure 3.1.1), with the rewards 5, 10 and -1."""
    return make_mdp(
        {
            (1,): {"a11": (5.0, {(1,): 0.5, (2,): 0.5}), "a12": (10.0, {(2,): 1.0})},
            (2,): {"a21": (-1.0, {(2,): 1.0})},
        }
    )


def _step(state: State, shift: State, size: int) -> State:
    moved = tuple(value + change for value, change in zip(state, shift, strict=True))
    return moved if all(0 <= value < size for value in moved) else state


SHIFTS: Mapping[str, State] = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}


def jump_grid() -> TabularMDP:
    """Sutton and Barto 2018, Example 3.5: 5 x 5, two cells from which every action jumps."""
    jumps: Mapping[State, tuple[float, State]] = {(0, 1): (10.0, (4, 1)), (0, 3): (5.0, (2, 3))}
    choices: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {}
    for cell in product(range(5), range(5)):
        choices[cell] = {}
        for name, shift in SHIFTS.items():
            target = _step(cell, shift, 5)
            reward, target = jumps.get(cell, (-1.0 if target == cell else 0.0, target))
            choices[cell][name] = (reward, {target: 1.0})
    return make_mdp(choices, variables=("row", "col"))


def corner_grid() -> TabularMDP:
    """Sutton and Barto 2018, Example 4.1: 4 x 4, every step costs 1 until a corner is reached."""
    corners = {(0, 0), (3, 3)}
    choices: Choices = {
        cell: {
            name: (0.0, {cell: 1.0}) if cell in corners else (-1.0, {_step(cell, shift, 4): 1.0})
            for name, shift in SHIFTS.items()
        }
        for cell in product(range(4), range(4))
    }
    return make_mdp(choices, variables=("row", "col"), initial={(1, 1): 1.0}, labels={"corner": corners})


def gambler(heads: float = 0.4) -> TabularMDP:
    """Sutton and Barto 2018, Example 4.3: the capital to stake at even odds until 0 or 100."""
    choices: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {}
    for capital in range(101):
        if capital in {0, 100}:
            choices[(capital,)] = {"stop": (0.0, {(capital,): 1.0})}
            continue
        choices[(capital,)] = {
            f"stake_{stake}": (0.0, {(capital - stake,): 1 - heads, (capital + stake,): heads})
            for stake in range(1, min(capital, 100 - capital) + 1)
        }
    return make_mdp(
        choices, variables=("capital",), initial={(50,): 1.0}, labels={"won": {(100,)}, "lost": {(0,)}}
    )


def end_component_trap() -> TabularMDP:
    """Return an MDP whose naive upper bound of Pmax stays 1 (after Haddad and Monmege 2018).

    States 0 and 1 can circle for ever; to leave is to win or lose with 1/2 each.
    """
    return make_mdp(
        {
            (0,): {"on": (0.0, {(1,): 1.0})},
            (1,): {"back": (0.0, {(0,): 1.0}), "leave": (0.0, {(2,): 0.5, (3,): 0.5})},
            (2,): {"stay": (0.0, {(2,): 1.0})},
            (3,): {"stay": (0.0, {(3,): 1.0})},
        },
        labels={"won": {(2,)}},
    )


def whole_paper_grid(
    size: int = 9,
    goal: State = (4, 4),
    blocked: Collection[State] = (),
    start: State = (0, 0),
    slip: float = 0.0,
) -> TabularMDP:
    """Return the paper's world as Storm builds it: variables row, col, done; only reachable states.

    Each step costs 0.5, `stop` in the goal earns 10, any action in the goal sets done, where
    only `end` is left. With `slip` a move fails with that probability.
    """
    moves: Mapping[str, State] = {"stop": (0, 0), **SHIFTS}
    choices: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {}
    queue: list[State] = [(*start, 0)]
    while queue:
        state = queue.pop(0)
        if state in choices:
            continue
        cell, done = state[:2], state[2]
        if done:
            choices[state] = {"end": (0.0, {state: 1.0})}
            continue
        choices[state] = {}
        flag = int(cell == goal)
        for name, shift in moves.items():
            ahead = _step(cell, shift, size)
            ahead = cell if ahead in blocked else ahead
            reward = 10.0 if name == "stop" and flag else -0.5
            moved, stayed = (*ahead, flag), (*cell, flag)
            uncertain = slip > 0 and moved != stayed
            branches = {moved: 1 - slip, stayed: slip} if uncertain else {moved: 1.0}
            choices[state][name] = (reward, branches)
            queue += branches
    complete = [state for state in choices if state[2]]
    return make_mdp(
        choices,
        variables=("row", "col", "done"),
        labels={"done": complete, "goal": [state for state in choices if state[:2] == goal]},
    )


def grid_cells(size: int = 9) -> Ints:
    """Return int64 [size * size, 2], the cells row by row: the canonical valuations of a grid."""
    return np.stack(np.divmod(np.arange(size * size), size), axis=1)


def random_mdp(
    generator: np.random.Generator,
    num_states: int = 12,
    num_actions: int = 3,
    num_branches: int = 3,
    num_sinks: int = 0,
) -> TabularMDP:
    """Each state has 1 to A actions, each choice 1 to K successors; rewards in -1..1.

    The first `num_sinks` states after the initial one are never left.
    """
    choices: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {}
    for state in range(num_states):
        enabled = generator.permutation(num_actions)[: generator.integers(1, num_actions + 1)]
        choices[(state,)] = {}
        for action in sorted(enabled.tolist()):
            count = int(generator.integers(1, num_branches + 1))
            targets = generator.permutation(num_states)[:count].tolist()
            probabilities = generator.dirichlet(np.ones(count)).tolist()
            branches: dict[State, float] = {
                (target,): prob for target, prob in zip(targets, probabilities, strict=True)
            }
            if 0 < state <= num_sinks:
                branches = {(state,): 1.0}
            choices[(state,)][f"a{action}"] = (float(generator.uniform(-1, 1)), branches)
    return make_mdp(
        choices,
        actions=tuple(f"a{action}" for action in range(num_actions)),
        labels={"target": {(num_states - 1,)}},
    )


def large_grid(size: int) -> TabularMDP:
    """size x size cells, four moves that succeed with 0.8; made without a loop over states."""
    num_states = size * size
    row, col = np.divmod(np.arange(num_states), size)
    shift = np.array(list(SHIFTS.values()))
    ahead_row = np.clip(row[:, None] + shift[:, 0], 0, size - 1)
    ahead_col = np.clip(col[:, None] + shift[:, 1], 0, size - 1)
    stay = np.broadcast_to(np.arange(num_states)[:, None], (num_states, 4))
    target = np.stack([ahead_row * size + ahead_col, stay], axis=2)
    prob = np.broadcast_to([0.8, 0.2], target.shape).copy()
    prob[target[:, :, 0] == stay] = [1.0, 0.0]
    kept = prob > 0
    return TabularMDP(
        state_to_choice=4 * np.arange(num_states + 1),
        choice_to_branch=np.concatenate(([0], np.cumsum(kept.sum(axis=2)))),
        branch_target=target[kept],
        branch_prob=prob[kept],
        choice_action=np.tile(np.arange(4), num_states),
        choice_reward=np.where(np.arange(num_states) == num_states - 1, 0.0, -1.0).repeat(4),
        initial=(np.arange(num_states) == 0).astype(np.float64),
        reachable=np.ones(num_states, dtype=np.bool_),
        labels={"corner": np.arange(num_states) == num_states - 1},
        valuations=np.stack([row, col], axis=1),
        variable_names=("row", "col"),
        action_names=tuple(SHIFTS),
    )
