"""Exploring with a shield and without: bench.py shield [--json FILE]."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from merap.concerns.case_study import load_case
from merap.experiments.shield_quality import SETTINGS, shield_figures

MODELS = Path(__file__).parents[1] / "models"
WIDTH = 140
COLUMNS = {
    "case": "case",
    "system": "system",
    "threshold": "lambda",
    "violations": "violations",
    "violation_limit": "95 % limit",
    "goal_rate_first": "goal, first",
    "goal_rate_last": "goal, last",
    "mean_return_first": "return, first",
    "mean_return_last": "return, last",
    "mean_episodes_to_goal": "episodes to goal",
    "robots_never_at_goal": "never",
    "credible_models_last": "credible",
    "seconds": "s",
}


def shield_rows(episodes: int = 10_000, seed: int = 0) -> list[dict[str, Any]]:
    """A row for each setting, and one without a shield for each system."""
    rows = []
    for (name, system), settings in groupby(SETTINGS, key=lambda one: (one.case, one.system)):
        thresholds = [one.threshold for one in settings]
        rows += list(shield_figures(load_case(MODELS / name), system, thresholds, episodes, seed))
    return rows


def shield(
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the rows.")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Exploring episodes of each row.")] = 10_000,
    seed: int = 0,
) -> None:
    """Violations, goals and returns of exploring episodes, shielded and not, with the same seeds."""
    rows = shield_rows(episodes, seed)
    table = Table(*COLUMNS.values(), title=f"{episodes} exploring episodes")
    for row in rows:
        table.add_row(*(_text(row[name]) for name in COLUMNS))
    Console(width=WIDTH).print(table)
    if json_file is not None:
        json_file.write_text(json.dumps(rows, indent=2) + "\n")


def _text(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    typer.run(shield)
