"""Measure the strategy `belief`: scripts.bench belief drawn | speed [--json FILE].

Episodes are those until within 5 percent of the optimum; `p95` is the least number that 95 percent of
the runs do not exceed. A run ends with the third row in a row within 5 percent, but has 10 episodes at least.
Regret is the optimum minus what those returned, with exploration, noise and luck.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from rich.progress import track

from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import load_declared_case
from scripts.bench.belief_quality import BeliefProblem, belief_problem, drawn_figures
from scripts.bench.following import CONDITIONS, Lengths, NoiseCondition
from scripts.bench.tables import Json, show, table, write_figures

MODELS = Path(__file__).parents[2] / "models"
# 10,626 environments of the paper's kind: any 4 of 24 cells are blocked.
LARGE = ("paper-grid/rq1-4.yaml", "{rows: [0, 6], cols: [1, 2]}", "{rows: [0, 7], cols: [1, 3]}")

T = TypeVar("T")
app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)
Names = Annotated[list[str] | None, typer.Option("--condition", help="none, noise, slip or both; all.")]


@app.callback()
def bench() -> None:
    """Measure how soon `belief` is within 5 percent, and how long it thinks."""


@app.command()
def drawn(
    json_file: Json = None,
    condition: Names = None,
    count: int = 200,
    first: int = 0,
    max_episodes: int = 60,
    worst: int = 10,
) -> None:
    """Adapt to grids, goals and faults drawn at random, once to each; show the worst."""
    numbers = range(first, first + count)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for chosen in chosen_conditions(condition):
            found = drawn_figures(numbers, chosen, Lengths(most=max_episodes), Path(folder))
            rows.extend(track(found, chosen.name, total=count))
    columns = ("condition", "outside", "cases", "median", "p95", "most", "never")
    _report("drawn", _grouped(rows), columns)
    slowest = sorted(rows, key=lambda row: -_number(row["episodes"]))[:worst]
    shown = ("case", "condition", "outside", "locations", "models", "optimum", "final", "episodes", "regret")
    _report("the worst", slowest, shown)
    write_figures(json_file, rows)


@app.command()
def speed(json_file: Json = None, episodes: int = 5) -> None:
    """Time a belief over 10,626 environments, the longest of each kind of call."""
    name, small, large = LARGE
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.yaml"
        path.write_text((MODELS / name).read_text(encoding="utf-8").replace(small, large), encoding="utf-8")
        began = time.perf_counter()
        problem = belief_problem(load_declared_case(path), CONDITIONS[-1])
        seconds = {"prepare": [time.perf_counter() - began], **_timed(problem, episodes)}
    rows = [
        {"call": call, "longest": max(each), "mean": statistics.mean(each), "calls": len(each)}
        for call, each in seconds.items()
    ]
    _report("seconds", rows, ("call", "longest", "mean", "calls"))
    write_figures(json_file, rows)


def _timed(problem: BeliefProblem, episodes: int) -> dict[str, list[float]]:
    """Return the seconds of every call of the strategy."""
    of_system, of_strategy = np.random.default_rng(0).spawn(2)
    system = problem.simulated(of_system)
    seconds: dict[str, list[float]] = {}

    def timed(name: str, call: Callable[[], T]) -> T:
        began = time.perf_counter()
        result = call()
        seconds.setdefault(name, []).append(time.perf_counter() - began)
        return result

    strategy = BeliefStrategy(problem.hypotheses, problem.truth.horizon, of_strategy)
    for _ in range(episodes):
        seen = system.reset()
        timed("begin", partial(strategy.begin, seen))
        while not seen.last:
            action = timed("act", partial(strategy.act, seen.enabled))
            seen = system.step(action)
            timed("observe", partial(strategy.observe, action, seen))
        timed("update", strategy.update)
        timed("policy", strategy.policy)
        timed("explain", strategy.explain)
    return seconds


def chosen_conditions(names: Sequence[str] | None) -> list[NoiseCondition]:
    """Return the conditions of these names; all of them if None."""
    known = {condition.name: condition for condition in CONDITIONS}
    wrong = [name for name in names or () if name not in known]
    if wrong:
        raise typer.BadParameter(f"there is no condition {wrong[0]!r}; allowed: {', '.join(known)}")
    return [known[name] for name in names or known]


def _grouped(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Build a row for each condition and for each set of concerns that lie outside the base."""
    groups: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        for outside in (row["outside"] or "nothing", "any"):
            groups.setdefault((row["condition"], outside), []).append(_number(row["episodes"]))
    return [
        {
            "condition": condition,
            "outside": outside,
            "cases": len(found),
            "median": sorted(found)[math.ceil(len(found) / 2) - 1],
            "p95": sorted(found)[math.ceil(0.95 * len(found)) - 1],
            "most": max(found),
            "never": found.count(math.inf),
        }
        for (condition, outside), found in sorted(groups.items())
    ]


def _number(episodes: int | None) -> float:
    return math.inf if episodes is None else episodes


def _report(title: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    show(table(title, rows, {name: name for name in columns}))


if __name__ == "__main__":
    app()
