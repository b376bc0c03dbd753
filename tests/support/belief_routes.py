"""The posterior by enumeration: every hypothesis as a model of its own, built by composition.

An independent route to `merap.belief`: it reads no table of it, only whole models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.belief.posterior import Belief, prior_belief, weights
from merap.belief.space import HypothesisSpace
from merap.belief.update import ObservedStep, observe_enabled, observe_presence, observe_step
from merap.concerns.case_study import DeclaredCase
from merap.concerns.combination import DeclaredCombination
from merap.families.models import explored
from merap.mdp.model import Floats, TabularMDP

Generator = np.random.Generator

# Two rows of three cells: small enough to enumerate every set of closed cells.
STRIP = """\
case: strip
discount: 0.9
space:
  grid: {rows: 2, cols: 3, moves: {up: [-1, 0], down: [1, 0], left: [0, -1], right: [0, 1]}}
environment:
  parameters: {blocked: locations}
  configurations: {a: {blocked: [[0, 1]]}, b: {blocked: [[1, 1]]}}
capability:
  parameters: {no_entry: locations}
  actions:
    stop: {stay: 1}
    up: {move: up, probability: 0.75}
    down: {move: down}
    left: {move: left}
    right: {move: right, on_blocked: disable}
  configurations: {full: {no_entry: []}, lame: {no_entry: [[1, 2]]}}
objective:
  parameters: {goal: location}
  start: [0, 0]
  horizon: 8
  rewards:
    - {at: goal, action: stop, value: 10}
    - {value: -0.5}
  ends_after: {at: goal}
  configurations: {right: {goal: [0, 2]}, low: {goal: [1, 2]}}
online:
  met: {environment: {blocked: [[0, 2]]}, capability: full, objective: {goal: [1, 1]}}
"""


@dataclass(frozen=True)
class Seen:
    """A step, and the actions that were enabled before it."""

    enabled: tuple[int, ...]
    step: ObservedStep


def trajectory(
    combination: DeclaredCombination, length: int, noise: float, generator: Generator
) -> list[Seen]:
    """Random enabled actions in a whole model, with noise on the rewards; a new episode after an end."""
    model = explored(combination)
    index = _states(combination, model)
    flag = model.labels["done"]
    start = int(np.flatnonzero(model.initial)[0])
    seen, state = [], start
    for _ in range(length):
        choices = np.arange(model.state_to_choice[state], model.state_to_choice[state + 1])
        choice = int(generator.choice(choices))
        branches = np.arange(model.choice_to_branch[choice], model.choice_to_branch[choice + 1])
        branch = int(generator.choice(branches, p=model.branch_prob[branches]))
        target = int(model.branch_target[branch])
        assert model.branch_reward is not None
        reward = float(model.branch_reward[branch]) + noise * float(generator.normal())
        after = len(index) if flag[target] else _canonical(index, target)
        step = ObservedStep(_canonical(index, state), int(model.choice_action[choice]), after, reward)
        seen.append(Seen(tuple(model.choice_action[choices].tolist()), step))
        state = start if flag[target] else target
    return seen


def _states(combination: DeclaredCombination, model: TabularMDP) -> list[int]:
    """Return the row of each canonical state that is not done; -1 if it is not reachable."""
    rows = {tuple(row): number for number, row in enumerate(model.valuations.tolist())}
    modes = range(len(combination.modes))
    return [
        rows.get((*place, mode, 0), -1) for place in combination.space.valuations.tolist() for mode in modes
    ]


def _canonical(index: list[int], row: int) -> int:
    return index.index(row)


def log_likelihood(
    combination: DeclaredCombination, seen: Sequence[Seen], noise: float, slip: float
) -> float:
    """Of a trajectory under one combination whose actions do nothing with probability `slip`."""
    model = explored(combination)
    index = _states(combination, model)
    total = 0.0
    for one in seen:
        density = _step_density(model, index, one, noise, slip)
        if density == 0:
            return -np.inf
        total += float(np.log(density))
    return total


def _step_density(model: TabularMDP, index: list[int], one: Seen, noise: float, slip: float) -> float:
    state, flag = index[one.step.state], model.labels["done"]
    if state < 0 or flag[state]:
        return 0.0
    choices = np.arange(model.state_to_choice[state], model.state_to_choice[state + 1])
    if tuple(model.choice_action[choices].tolist()) != one.enabled:
        return 0.0
    choice = choices[one.enabled.index(one.step.action)]
    assert model.branch_reward is not None
    density = 0.0
    for branch in range(model.choice_to_branch[choice], model.choice_to_branch[choice + 1]):
        target = int(model.branch_target[branch])
        arrived = flag[target] if one.step.target == len(index) else index[one.step.target] == target
        deviation = (one.step.reward - model.branch_reward[branch]) / noise
        density += (1 - slip) * arrived * model.branch_prob[branch] * np.exp(-0.5 * deviation**2)
    if slip:
        density += slip * _slipped(model, index, one, noise, choice)
    return float(density)


def _slipped(model: TabularMDP, index: list[int], one: Seen, noise: float, choice: int) -> float:
    """In cases whose rewards and ends do not read the successor, a slip pays and ends as any step."""
    first = int(model.choice_to_branch[choice])
    ends = bool(model.labels["done"][model.branch_target[first]])
    arrived = one.step.target == len(index) if ends else one.step.target == one.step.state
    assert model.branch_reward is not None
    deviation = (one.step.reward - model.branch_reward[first]) / noise
    return float(arrived * np.exp(-0.5 * deviation**2))


def inferred(case: DeclaredCase, space: HypothesisSpace, seen: Sequence[Seen]) -> Belief:
    """Return the belief after a trajectory."""
    belief = observe_presence(space, prior_belief(space), int(np.flatnonzero(space.initial)[0]))
    for one in seen:
        enabled = np.isin(np.arange(len(case.actions)), one.enabled)
        belief = observe_enabled(space, belief, one.step.state, enabled)
        belief = observe_step(space, belief, one.step)
    return belief


def joint(space: HypothesisSpace, belief: Belief) -> Floats:
    """[all environments, C, W, O] probabilities, whatever the belief keeps them as."""
    dynamics, objective = weights(belief)
    product_of = dynamics[..., np.newaxis] * objective.sum(axis=1)
    if belief.coupled is not None:
        shares = np.exp(belief.coupled - belief.coupled.max())
        product_of = (shares / shares.sum()).sum(axis=4)
    everywhere = np.zeros((len(space.environment_names), *product_of.shape[1:]))
    everywhere[belief.environments] = product_of
    return everywhere
