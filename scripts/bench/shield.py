"""Exploring and adapting with a shield and without: scripts.bench shield [--json FILE]."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer

from merap.concerns.case_study import load_declared_case
from scripts.bench.shield_adaptation import ADAPTING, STRATEGIES, adaptation_figures
from scripts.bench.shield_quality import SETTINGS, shield_figures
from scripts.bench.tables import Json, show, table, write_figures

MODELS = Path(__file__).parents[2] / "models"
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
    """Adapt with and without the product's shield; return a row for each strategy and threshold."""
    return [
        adaptation_figures(
            load_declared_case(MODELS / one.case), one.system, strategy, threshold, episodes, seed
        )
        for one in ADAPTING
        for strategy in STRATEGIES
        for threshold in (None, one.threshold)
    ]


def shield_rows(episodes: int = 10_000, seed: int = 0) -> list[dict[str, Any]]:
    """Return a row for each setting, and one without a shield for each system."""
    rows = []
    for (name, system), settings in groupby(SETTINGS, key=lambda one: (one.case, one.system)):
        thresholds = [one.threshold for one in settings]
        rows += list(shield_figures(load_declared_case(MODELS / name), system, thresholds, episodes, seed))
    return rows


def shield(
    json_file: Json = None,
    episodes: Annotated[int, typer.Option(min=1, help="Exploring episodes of each row.")] = 10_000,
    adapting: Annotated[int, typer.Option(min=1, help="Adapting episodes of each row.")] = 200,
    seed: int = 0,
) -> None:
    """Count violations, goals and returns of exploring and adapting episodes, with a shield and without."""
    exploring = shield_rows(episodes, seed)
    show(table(f"{episodes} exploring episodes", exploring, COLUMNS))
    adapted = adapting_rows(adapting, seed)
    show(table(f"{adapting} adapting episodes", adapted, ADAPTING_COLUMNS))
    write_figures(json_file, {"exploring": exploring, "adapting": adapted})


if __name__ == "__main__":
    typer.run(shield)
