"""Small outcome sets made by hand or at random, and the risk by enumeration of all policies and models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import product
from pathlib import Path

import numpy as np

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.mdp.model import Bools, Floats, Ints
from merap.shield.outcomes import OutcomeSets, outcome_sets, rows

# State -> action -> distributions nature may pick from, each successor -> probability.
Sets = Mapping[int, Mapping[int, Sequence[Mapping[int, float]]]]


def make_sets(
    choices: Sets,
    unsafe: set[int],
    *,
    num_states: int,
    num_actions: int = 2,
    unsure: AbstractSet[tuple[int, int]] = frozenset(),
) -> OutcomeSets:
    """Outcome sets as they are written; `unsure` are the (state, action) some model disables."""
    flat = [
        (state * num_actions + action, distribution)
        for state, actions in choices.items()
        for action, found in actions.items()
        for distribution in found
    ]
    width = max(len(distribution) for _, distribution in flat)
    target = np.zeros((len(flat), width), dtype=np.int64)
    prob = np.zeros((len(flat), width))
    for row, (_, distribution) in enumerate(flat):
        target[row, : len(distribution)] = list(distribution)
        prob[row, : len(distribution)] = list(distribution.values())
    sure = np.ones((num_states, num_actions), dtype=np.bool_)
    for place in unsure:
        sure[place] = False
    choice = np.array([number for number, _ in flat])
    mask = np.isin(np.arange(num_states), list(unsafe))
    return outcome_sets(rows(choice, target, prob, np.zeros_like(prob)), sure, mask, num_actions)


def random_sets(
    generator: np.random.Generator, num_states: int = 4, num_actions: int = 2, most: int = 3
) -> tuple[Sets, OutcomeSets]:
    """One to `most` distributions in each choice; the last state is unsafe, state 1 is never left."""
    choices: dict[int, dict[int, list[dict[int, float]]]] = {}
    for state in range(num_states - 1):
        choices[state] = {}
        for action in range(num_actions):
            found = []
            for _ in range(int(generator.integers(1, most + 1))):
                count = int(generator.integers(1, 4))
                targets = generator.permutation(num_states)[:count].tolist()
                weights = generator.dirichlet(np.ones(count)).tolist()
                found.append(dict(zip(targets, weights, strict=True)))
            choices[state][action] = [{state: 1.0}] if state == 1 else found
    return choices, make_sets(choices, {num_states - 1}, num_states=num_states, num_actions=num_actions)


def enumerated_risk(choices: Sets, unsafe: Bools) -> Floats:
    """min over policies, max over nature's picks, of the probability of ever reaching an unsafe state.

    Both are stationary and deterministic, which is enough in a game with perfect information.
    """
    states = sorted(choices)
    best = np.full(len(unsafe), np.inf)
    for policy in product(*(sorted(choices[state]) for state in states)):
        worst = np.zeros(len(unsafe))
        options = [choices[state][action] for state, action in zip(states, policy, strict=True)]
        for nature in product(*options):
            chain = np.eye(len(unsafe))
            for state, distribution in zip(states, nature, strict=True):
                chain[state] = 0.0
                for target, prob in distribution.items():
                    chain[state, target] += prob
            worst = np.maximum(worst, _reaching(chain, unsafe))
        best = np.minimum(best, worst)
    return best


def _reaching(chain: Floats, target: Bools) -> Floats:
    """Return the probability of ever reaching the target in a Markov chain, by linear equations."""
    reaching = target.copy()
    for _ in range(len(chain)):
        reaching = target | ((chain > 0) @ reaching)
    inner: Ints = np.flatnonzero(reaching & ~target)
    value = target.astype(np.float64)
    if len(inner):
        system = np.eye(len(inner)) - chain[np.ix_(inner, inner)]
        value[inner] = np.linalg.solve(system, chain[inner][:, target].sum(axis=1))
    return value


# Five steps beside a gutter: `right` slides into it by 0.1 or, if it is wet, by 0.2.
GUTTER = """\
case: gutter
discount: 0.98
space:
  grid: {rows: 2, cols: 6, moves: {down: [1, 0], right: [0, 1]}}
  attributes:
    gutter: {type: bool, default: false}
environment:
  parameters: {low: locations}
  attributes: {gutter: [{at: low, value: true}]}
  configurations: {only: {low: {rows: [1, 1], cols: [0, 5]}}}
capability:
  parameters: {slide: probability}
  actions:
    stop: {stay: 1}
    right:
      outcomes:
        - {move: right, probability: 1 - slide}
        - {move: down, probability: slide}
  configurations: {dry: {slide: 0.1}, wet: {slide: 0.2}}
objective:
  parameters: {goal: location}
  start: [0, 0]
  horizon: 10
  unsafe: gutter
  rewards:
    - {at: goal, action: stop, value: 10}
    - {value: -1}
  ends_after: {at: goal, action: stop}
  configurations: {far: {goal: [0, 5]}}
online:
  met: {environment: only, capability: dry, objective: far}
"""


def gutter(folder: Path) -> DeclaredCase:
    """Return the case, written into a folder."""
    path = folder / "gutter.yaml"
    path.write_text(GUTTER, encoding="utf-8")
    return load_declared_case(path)
