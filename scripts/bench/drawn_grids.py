"""Grids, goals and faults drawn at random: what no strategy can have been tuned to.

A drawn case is of the paper's kind: actions, rewards and a horizon of twice the size as in its
eight cases; everything else is drawn. What is met is drawn too: each concern is covered by the
base with probability one half.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.mdp.model import Floats

SIZES = range(6, 15)
COVERED = 0.5
Cell = tuple[int, int]

TEXT = """\
case: drawn_{number}
discount: 0.95
space:
  grid: {{rows: {size}, cols: {size}, moves: {{up: [-1, 0], down: [1, 0], left: [0, -1], right: [0, 1]}}}}
environment:
  parameters: {{blocked: locations}}
  configurations:
    generate: {{blocked: {{choose: {num_blocked}, from: {obstacles}}}}}
    require_reachable: true
capability:
  parameters: {{no_entry: locations}}
  actions:
    stop: {{stay: 1}}
    up: {{move: up}}
    down: {{move: down}}
    left: {{move: left}}
    right: {{move: right}}
  configurations: {{generate: {{no_entry: {{choose: 1, from: {faults}}}}}}}
objective:
  parameters: {{goal: location}}
  start: {start}
  horizon: {horizon}
  rewards:
    - {{at: goal, action: stop, value: 10}}
    - {{value: -0.5}}
  ends_after: {{at: goal}}
  configurations: {{generate: {{goal: {{from: {goals}}}}}}}
online:
  met:
    environment: {{blocked: {met_blocked}}}
    capability: {{no_entry: {met_faults}}}
    objective: {{goal: {met_goal}}}
"""


def drawn_case(number: int, folder: Path) -> DeclaredCase:
    """Return the case with that number; its file is written into a folder that exists.

    Args:
        number: the seed of everything that is drawn.
        folder: where `drawn_<number>.yaml` goes.
    """
    path = folder / f"drawn_{number}.yaml"
    path.write_text(drawn_text(number), encoding="utf-8")
    return load_declared_case(path)


def drawn_text(number: int) -> str:
    """Return the text of the case with that number: drawn until its goals can be reached in time."""
    generator = np.random.default_rng(number)
    size = int(generator.choice(SIZES))
    while True:
        drawn = _Draw(size, generator)
        if drawn.sound():
            return drawn.text(number)


class _Draw:
    """One draw of everything, sound or not."""

    def __init__(self, size: int, generator: np.random.Generator) -> None:
        cells = [divmod(int(cell), size) for cell in generator.permutation(size * size)]
        self.size, self.horizon = size, 2 * size
        self.start, *cells = cells
        counts = generator.integers([4, 3, 3], [13, 6, 10])
        first, second, third = np.cumsum(counts)
        self.obstacles, self.faults, self.goals = cells[:first], cells[first:second], cells[second:third]
        self.num_blocked = int(generator.integers(1, 5))
        self.met_blocked = self.obstacles[: self.num_blocked]
        self.met_faults = self.faults[:1]
        self.met_goal = self.goals[0]
        free = cells[third:]
        if generator.random() > COVERED:
            self.met_blocked = free[: int(generator.integers(0, size))]
            free = free[len(self.met_blocked) :]
        if generator.random() > COVERED:
            self.met_faults = free[: int(generator.integers(1, 3))]
            free = free[len(self.met_faults) :]
        if generator.random() > COVERED:
            self.met_goal = free[0]

    def sound(self) -> bool:
        """Whether the goals can be reached in time, in what is met and with everything closed at once."""
        away = _distances(self.size, self.start, {*self.met_blocked, *self.met_faults})
        if not away[self.met_goal] <= self.horizon - 1:
            return False
        worst = _distances(self.size, self.start, {*self.obstacles, *self.faults})
        return all(worst[goal] <= self.horizon - 1 for goal in self.goals)

    def text(self, number: int) -> str:
        """Return it as a case file."""
        return TEXT.format(
            number=number,
            size=self.size,
            horizon=self.horizon,
            num_blocked=self.num_blocked,
            obstacles=_listed(self.obstacles),
            faults=_listed(self.faults),
            start=list(self.start),
            goals=_listed(self.goals),
            met_blocked=_listed(self.met_blocked),
            met_faults=_listed(self.met_faults),
            met_goal=list(self.met_goal),
        )


def _listed(cells: Iterable[Cell]) -> list[list[int]]:
    return [list(cell) for cell in sorted(cells)]


def _distances(size: int, start: Cell, closed: set[Cell]) -> Floats:
    """Return float64 [size, size], steps from the start; infinite where there is no way."""
    is_open = np.ones((size, size), dtype=np.bool_)
    for cell in closed:
        is_open[cell] = False
    number = np.arange(size * size).reshape(size, size)
    down, right = is_open[1:] & is_open[:-1], is_open[:, 1:] & is_open[:, :-1]
    first = np.concatenate([number[:-1][down], number[:, :-1][right]])
    second = np.concatenate([number[1:][down], number[:, 1:][right]])
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(size * size, size * size))
    steps: Floats = dijkstra(graph.tocsr(), directed=False, indices=int(number[start]), unweighted=True)
    return steps.reshape(size, size)
