"""Exploring and adapting with a shield and without: scripts.bench shield [--json FILE]."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from merap.concerns.case_study import load_case
from scripts.bench.shield_adaptation import ADAPTING, STRATEGIES, adaptation_figures
from scripts.bench.shield_quality import SETTINGS, shield_figures

MODELS = Path(__file__).parents[2] / "models"
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


ADAPTING_COLUMNS = {
    "case": "case",
    "system": "system",
    "strategy": "strategy",
    "threshold": "lambda",
    "violations": "violations",
    "violation_limit": "95 % limit",
    "completed": "at the goal",
    "fallback_steps": "fallbacks",
    "mean_return": "return",
    "seconds": "s",
}


def adapting_rows(episodes: int = 200, seed: int = 0) -> list[dict[str, Any]]:
    """Strategies as they are, behind the product's shield and without."""
    return [
        adaptation_figures(load_case(MODELS / one.case), one.system, strategy, threshold, episodes, seed)
        for one in ADAPTING
        for strategy in STRATEGIES
        for threshold in (None, one.threshold)
    ]


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
    adapting: Annotated[int, typer.Option(min=1, help="Adapting episodes of each row.")] = 200,
    seed: int = 0,
) -> None:
    """Violations, goals and returns of exploring and adapting episodes, with a shield and without."""
    exploring = shield_rows(episodes, seed)
    _show(f"{episodes} exploring episodes", exploring, COLUMNS)
    adapted = adapting_rows(adapting, seed)
    _show(f"{adapting} adapting episodes", adapted, ADAPTING_COLUMNS)
    if json_file is not None:
        found = {"exploring": exploring, "adapting": adapted}
        json_file.write_text(json.dumps(found, indent=2) + "\n")


def _show(title: str, rows: list[dict[str, Any]], columns: Mapping[str, str]) -> None:
    table = Table(*columns.values(), title=title)
    for row in rows:
        table.add_row(*(_text(row[name]) for name in columns))
    Console(width=WIDTH).print(table)


def _text(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    typer.run(shield)
