"""The paper's 9 x 9 world as canonical models, made by hand with numpy.

An independent source: nothing here reads a case file, renders PRISM or calls Storm.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from merap.mdp.assembly import Branches, assemble
from merap.mdp.graph import reachable_along
from merap.mdp.model import TabularMDP

SIZE = 9
COMPLETED = SIZE * SIZE
ACTIONS = ("stop", "up", "down", "left", "right", "end")
END = len(ACTIONS) - 1
MOVES = np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)])
HORIZON = 18
DISCOUNT = 0.95

Cell = tuple[int, int]


@dataclass(frozen=True)
class GridTask:
    """A goal, and the cells where nothing can be."""

    goal: Cell
    closed: frozenset[Cell] = frozenset()

    @property
    def optimum(self) -> float:
        """10 - 0.5 d with d the shortest path (the paper's README); by breadth-first search."""
        distance = {(0, 0): 0}
        frontier = [(0, 0)]
        for row, column in frontier:
            for down, right in MOVES[1:].tolist():
                cell = (row + down, column + right)
                inside = 0 <= cell[0] < SIZE and 0 <= cell[1] < SIZE
                if inside and cell not in self.closed and cell not in distance:
                    distance[cell] = distance[(row, column)] + 1
                    frontier.append(cell)
        return 10 - 0.5 * distance[self.goal]


def grid_task(goal: Cell, closed: Iterable[Cell] = ()) -> GridTask:
    return GridTask(goal, frozenset(closed))


def block(rows: tuple[int, int], columns: tuple[int, int]) -> list[Cell]:
    """All cells in rows and columns, both ends included."""
    return list(product(range(rows[0], rows[1] + 1), range(columns[0], columns[1] + 1)))


def grid_model(task: GridTask, slip: float = 0.0) -> TabularMDP:
    """Return the canonical model: 81 cells and the completed state; rows of unreachable cells are empty.

    Args:
        task: goal and closed cells.
        slip: the probability that a move leaves the robot where it is (the paper has 0).
    """
    cells = np.arange(COMPLETED)
    state, action = (axis.ravel() for axis in np.meshgrid(cells, np.arange(len(MOVES)), indexing="ij"))
    row, column = state // SIZE + MOVES[action, 0], state % SIZE + MOVES[action, 1]
    inside = (row >= 0) & (row < SIZE) & (column >= 0) & (column < SIZE)
    target = np.where(inside, row * SIZE + column, state)
    closed = np.array([r * SIZE + c for r, c in task.closed], dtype=np.int64)
    target = np.where(np.isin(target, closed), state, target)
    at_goal = state == task.goal[0] * SIZE + task.goal[1]
    reward = np.where(at_goal & (action == 0), 10.0, -0.5)
    moved = Branches(
        state, action, np.where(at_goal, COMPLETED, target), np.full(len(state), 1 - slip), reward
    )
    slipped = Branches(state, action, np.where(at_goal, COMPLETED, state), np.full(len(state), slip), reward)
    return _assemble(moved, slipped)


def _assemble(moved: Branches, slipped: Branches) -> TabularMDP:
    initial = np.zeros(COMPLETED + 1)
    initial[0] = 1
    ending = (np.array([COMPLETED]), np.array([END]), np.array([COMPLETED]), np.array([1.0]), np.array([0.0]))
    columns = zip(
        (moved.state, moved.action, moved.target, moved.prob, moved.reward),
        (slipped.state, slipped.action, slipped.target, slipped.prob, slipped.reward),
        ending,
        strict=True,
    )
    state, action, target, prob, reward = (np.concatenate(parts) for parts in columns)
    reachable = reachable_along(state, target, initial > 0)
    kept = reachable[state]
    cells = np.arange(COMPLETED)
    valuations = np.stack([cells // SIZE, cells % SIZE], axis=1)
    done = np.zeros(COMPLETED + 1, dtype=np.bool_)
    done[COMPLETED] = True
    return assemble(
        Branches(state[kept], action[kept], target[kept], prob[kept], reward[kept]),
        initial=initial,
        labels={"done": done},
        valuations=np.vstack([valuations, [[-1, -1]]]),
        variable_names=("row", "col"),
        action_names=ACTIONS,
    )
