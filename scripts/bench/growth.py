"""Measure how the costs of learning grow with states, branches and members: scripts.bench growth.

The programs are slippery grids, on which a battery drains; members differ in where a rock lies and in odds.
"""

from __future__ import annotations

import multiprocessing
import resource
import statistics
from collections.abc import Sequence
from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import matplotlib.pyplot as plt
import typer
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.training import initial_state, policy_network, updates
from merap.mdp.index import new_index
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.program.arrays import tabular
from merap.program.closing import closed
from merap.program.exploration import explore
from merap.program.expressions import Constant
from scripts.bench.evidence import slippery_grid
from scripts.bench.tables import Json, figures_by_name, show, timed, write_figures

Plot = Annotated[Path | None, typer.Option("--plot", help="Draw the growth (PNG, SVG, ...).")]
Figures = dict[str, float]

# About 10^3, 10^4 and 10^5 states, with six levels of power.
SIDES = (13, 41, 129)
TASKS, MANY_TASKS, HORIZON, DISCOUNT = 4, 16, 18, 0.95
MEMBERS, SMALL_SIDE = (100, 1_000, 10_000), 4
FOR_EVER = 1_000_000_000


def growth(json_file: Json = None, plot: Plot = None, repeats: int = 5) -> None:
    """Time an exact update on 10^3 to 10^5 states and 10^2 to 10^4 members, and count bytes."""
    figures = growth_figures(repeats)
    show(figures_by_name("growth of an exact update", figures))
    write_figures(json_file, figures)
    if plot is not None:
        _draw(figures, plot)


def growth_figures(repeats: int = 5) -> Figures:
    """Return what learning costs by states and branches, and by members."""
    figures = {"gigabytes_16_tasks": _gigabytes()}
    for side in SIDES:
        figures |= _by_branches(side, repeats)
    for count in MEMBERS:
        figures |= _by_members(count, repeats)
    return figures


def _by_branches(side: int, repeats: int) -> Figures:
    """Time an update; count the bytes of a branch, and of a further one at as many states."""
    dry, slippery = (batch_of(members(side, TASKS, slip)) for slip in (Fraction(0), Fraction(1, 5)))
    seconds, branches = _update_seconds(slippery, repeats), len(slippery.branch_prob)
    name = f"{slippery.num_states}_states"
    return {
        f"{name}_branches": branches,
        f"{name}_update_seconds": seconds,
        f"{name}_nanoseconds_per_branch": 1e9 * seconds / branches,
        f"{name}_bytes_per_branch": num_bytes(slippery) / branches,
        f"{name}_bytes_per_further_branch": (num_bytes(slippery) - num_bytes(dry))
        / (branches - len(dry.branch_prob)),
    }


def _by_members(count: int, repeats: int) -> Figures:
    """Time the building of so many members and an update on some of them; count the bytes of a member."""
    seconds, batch = timed(lambda: batch_of(members(SMALL_SIDE, count, Fraction(1, 5))))
    name = f"{count}_members"
    return {
        f"{name}_build_milliseconds_each": 1e3 * seconds / count,
        f"{name}_bytes_each": num_bytes(batch) / count,
        f"{name}_update_seconds": _update_seconds(batch, repeats),
    }


def members(side: int, count: int, slip: Fraction) -> list[TabularMDP]:
    """Explore grids with a rock in one place each, not at the start; no state is complete."""
    whole = replace(slippery_grid(side), labels={COMPLETE_LABEL: Constant(False)})
    members = []
    for number in range(count):
        row, col = divmod(1 + number % (side**2 - 1), side)
        values = {
            "rock_row": Fraction(row),
            "rock_col": Fraction(col),
            "slip": slip,
            "drain": Fraction(number % 50 + 1, 51),
            "need": Fraction(number % 3),
        }
        program = closed(whole, values)
        members.append(tabular(program, explore(program), reward="earned"))
    return members


def batch_of(models: Sequence[TabularMDP]) -> TaskBatch:
    """Put members on one index; episodes begin in any state, so that all matter within the horizon."""
    index = new_index(models[0].variable_names, slippery_grid(2).actions).extended(*models)
    placed = [index.place(model) for model in models]
    spread = [replace(one, initial=one.reachable / one.reachable.sum()) for one in placed]
    return task_batch(spread, HORIZON, DISCOUNT)


def num_bytes(batch: TaskBatch) -> int:
    values = (getattr(batch, field.name) for field in fields(batch))
    return sum(value.nbytes for value in values if isinstance(value, Tensor))


def _update_seconds(tasks: TaskBatch, repeats: int) -> float:
    config = TrainingConfig(updates=FOR_EVER, tasks_per_update=min(tasks.num_tasks, MANY_TASKS))
    state = initial_state(policy_network(tasks, config), config)
    rows = updates(tasks, config, state)
    next(rows)
    return statistics.median(next(rows).seconds for _ in range(repeats))


def _gigabytes() -> float:
    """Return peak memory of a process of its own that makes two updates of 16 tasks with 10^5 states."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_peak)


def _peak() -> float:
    _update_seconds(batch_of(members(SIDES[-1], MANY_TASKS, Fraction(1, 5))), 1)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _draw(figures: Figures, path: Path) -> None:
    branches, seconds = (
        [value for name, value in figures.items() if name.endswith(f"states_{part}")]
        for part in ("branches", "update_seconds")
    )
    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    axes.loglog(branches, seconds, "o-", label="measured")
    axes.loglog(branches, [seconds[-1] * count / branches[-1] for count in branches], "--", label="linear")
    axes.set(xlabel=f"branches of {TASKS} tasks", ylabel="seconds of an exact update")
    axes.legend(frameon=False)
    figure.savefig(path)
