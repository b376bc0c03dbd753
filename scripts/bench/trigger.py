"""Measure the trigger: scripts.bench trigger [--json FILE] [--plot FILE].

With 10 % slip and Gaussian noise of 0.5 on rewards, both stated: 10^5 steps without a change in each
stream; changes to other combinations, which differ in one concern or in all; the curve of delay against
false alarms, beside the paper's trigger.
"""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track
from rich.table import Table

from merap.concerns.case_study import CaseStudy
from merap.families.loading import load_case
from merap.mdp.model import Floats
from merap.report.saving import save_figure
from merap.trigger.readings import Readings
from merap.trigger.settings import WindowSettings
from scripts.bench.tables import Json, figures_by_name, show, table, write_figures
from scripts.bench.trigger_batch import count_alarms, window_rewards
from scripts.bench.trigger_curve import STEPS, Point, change_curve, window_curve
from scripts.bench.trigger_delay import (
    KINDS,
    Watched,
    World,
    changes,
    unchanged,
    watch,
    wear,
)
from scripts.bench.trigger_delays_figure import draw_delays
from scripts.bench.trigger_score import beside_bound, of_kind, score_change, without_change
from scripts.bench.trigger_streams import gaussian, known

MODELS = Path(__file__).parents[2] / "models"
CASES = ("paper-grid/rq1-1.yaml", "paper-grid/rq1-2.yaml", "paper-grid/rq1-4.yaml", "running-example")
# Episodes after a change; one that costs nothing must stay without an alarm for longer.
EPISODES = {"costly": 60, "small": 60, "harmless": 200, "off the path": 200}
# Streams without a change that the curves are made from.
CURVE_STREAMS = 20
NOISE = 0.5
# Student's t with three degrees of freedom has a standard deviation of sqrt(3).
HEAVY = 3
# What slip becomes, from the 0.1 that is stated.
SLIPS = (0.2, 0.3, 0.4, 0.5)
LOG_THRESHOLDS = (5, 7, 9, 11, 13.8, 16.1, 19)
MARGINS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13)
WINDOWS = {
    "the paper's window: an episode": WindowSettings(threshold=0.0, discount=0.95),
    "the paper's window: 50 steps": WindowSettings(threshold=0.0, discount=0.95, steps=50),
}


def heavy_tailed(generator: np.random.Generator, count: int) -> Floats:
    """Draw noise of the stated standard deviation, but with large outliers."""
    drawn: Floats = NOISE / np.sqrt(HEAVY) * generator.standard_t(HEAVY, count)
    return drawn


# The real system, where it is not quite the stated one.
WORLDS = {
    "as stated": World(),
    "noise half of what is stated": World(real_noise=gaussian(NOISE / 2)),
    "noise twice what is stated": World(real_noise=gaussian(NOISE * 2)),
    "heavy-tailed noise": World(real_noise=heavy_tailed),
    "less slip": World(real_slip=0.05),
    "more slip": World(real_slip=0.15),
    "lost steps": World(lost=0.1),
    "stated as symmetric": World(tails="symmetric"),
    "symmetric, noise twice what is stated": World(real_noise=gaussian(NOISE * 2), tails="symmetric"),
    "symmetric, heavy-tailed noise": World(real_noise=heavy_tailed, tails="symmetric"),
}

Plot = Annotated[Path | None, typer.Option(help="Draw the curve of delay against false alarms.")]


def trigger(
    json_file: Json = None,
    plot: Plot = None,
    case: Annotated[list[str] | None, typer.Option(help="Below models/; four shipped ones.")] = None,
    world: Annotated[str, typer.Option(help=f"What is there: {', '.join(WORLDS)}.")] = "as stated",
    combinations: Annotated[int, typer.Option(help="Without a change, for each case.")] = 5,
    changed: Annotated[int, typer.Option(help="Changes drawn for each case.")] = 50,
    quiet: Annotated[int, typer.Option(help="Streams without a change, for each combination.")] = 4,
    seeds: Annotated[int, typer.Option(help="Streams for each change.")] = 20,
    seed: int = 0,
) -> None:
    """Measure false alarms and delays of the trigger; with --json or --plot also over its thresholds."""
    if world not in WORLDS:
        raise typer.BadParameter(f"there is no world {world!r}; allowed: {', '.join(WORLDS)}")
    began = time.perf_counter()
    generator = np.random.default_rng(seed)
    streams = _Streams(WORLDS[world], combinations, changed, quiet, seeds)
    for name in case or CASES:
        streams.add(load_case(MODELS / name), generator)
    figures = {"world": world, **streams.figures()}
    if plot is not None or json_file is not None:
        curves = streams.curves()
        figures["curves"] = {name: [asdict(point) for point in points] for name, points in curves.items()}
        if plot is not None:
            pairs = {
                name: [(one.false_alarms, one.delay) for one in points] for name, points in curves.items()
            }
            save_figure(draw_delays(pairs, "Delay against false alarms"), plot, force=True)
    figures["seconds"] = time.perf_counter() - began
    _show(figures)
    write_figures(json_file, figures)


class _Streams:
    """What is measured: streams without a change, and with one."""

    def __init__(self, world: World, combinations: int, changed: int, quiet: int, seeds: int) -> None:
        self._world, self._per_combination, self._seeds = world, quiet, seeds
        self._combinations, self._changed = combinations, changed
        self._quiet: list[Readings] = []
        self._costly: list[Watched] = []
        self._rows: list[dict[str, Any]] = []
        self._worn: list[dict[str, Any]] = []

    def add(self, study: CaseStudy, generator: np.random.Generator) -> None:
        """Draw streams of a case."""
        self._quiet += _quiet(study, self._world, self._combinations, self._per_combination, generator)
        drawn = changes(study, self._changed, self._world, generator)
        for one in track(drawn, study.name, total=self._changed):
            watched = watch(one, self._world, self._seeds, EPISODES[one.kind], generator)
            self._rows.append(score_change(study.name, watched, self._world, generator))
            if one.kind == "costly":
                self._costly.append(watched)
        for slip in SLIPS:
            for one in wear(study, slip, self._combinations, self._world, generator):
                watched = watch(one, self._world, self._seeds, EPISODES[one.kind], generator)
                self._worn.append({"slip": slip, **score_change(study.name, watched, self._world, generator)})

    def figures(self) -> dict[str, Any]:
        """Return figures with the settings as they are."""
        settings, rows = self._world.settings, self._rows
        return {
            "settings": settings.model_dump(),
            "without a change": without_change(
                [count_alarms(settings, readings) for readings in self._quiet]
            ),
            "kinds": {kind: of_kind([one for one in rows if one["kind"] == kind]) for kind in KINDS},
            "beside the bound": {name: beside_bound(group) for name, group in self._groups().items()},
            "changes": rows + self._worn,
        }

    def _groups(self) -> dict[str, list[dict[str, Any]]]:
        """Return the rows of changes in groups."""
        slips = {f"slip {slip}": [one for one in self._worn if one["slip"] == slip] for slip in SLIPS}
        return {"drawn": self._rows, **slips}

    def curves(self) -> dict[str, list[Point]]:
        """Return the curve of each trigger over its thresholds."""
        quiet = self._quiet[:: max(1, len(self._quiet) // CURVE_STREAMS)]
        return _curves(self._world, quiet, self._costly)


def _quiet(
    study: CaseStudy, world: World, combinations: int, seeds: int, generator: np.random.Generator
) -> list[Readings]:
    streams = []
    for combination in study.sample(min(combinations, study.size), generator):
        before, same = known(combination, world.slip), world.model(combination)
        streams += [unchanged(before, same, world, STEPS, generator) for _ in range(seeds)]
    return streams


def _curves(world: World, quiet: list[Readings], costly: list[Watched]) -> dict[str, list[Point]]:
    longest = EPISODES["costly"]
    curves = {"change detector": change_curve(world.settings, quiet, costly, LOG_THRESHOLDS, longest)}
    for name, settings in WINDOWS.items():
        pairs = []
        for watched in costly:
            before = [readings.part(slice(0, begin)) for readings, begin in watched.streams]
            rewards = [window_rewards(settings, readings)[1] for readings in before]
            pairs.append((watched, float(np.concatenate(rewards).mean())))
        curves[name] = window_curve(settings, quiet, pairs, MARGINS, longest)
    return curves


def _show(figures: dict[str, Any]) -> None:
    show(
        figures_by_name(f"without a change ({figures['world']})", figures["without a change"]),
        _named("with a change", "kind", figures["kinds"]),
        _named("costly, beside what any detector can do", "changes", figures["beside the bound"]),
        *([_curve_table(figures["curves"])] if "curves" in figures else []),
        f"{figures['seconds']:.0f} s",
    )


def _named(title: str, first: str, rows: dict[Any, dict[str, Any]]) -> Table:
    columns = {"": first} | {name: name for name in next(iter(rows.values()))}
    return table(title, ({"": str(name), **row} for name, row in rows.items()), columns)


def _curve_table(curves: dict[str, list[dict[str, float]]]) -> Table:
    columns = {
        "": "trigger",
        "threshold": "threshold",
        "false_alarms": "false alarms in 100,000",
        "delay": "mean delay",
        "soon": "within 3",
    }
    rows = ({"": name, **point} for name, points in curves.items() for point in points)
    return table("curves", rows, columns)


if __name__ == "__main__":
    typer.run(trigger)
