"""Every adaptation strategy on the paper's cases and the running example: scripts.bench online [--json FILE].

Without `--condition`, all strategies meet them undisturbed, and `belief` also with noise on rewards, with
slip, and with both. `belief` on 200 drawn cases: scripts.bench belief drawn.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import track
from rich.table import Table

from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.runs.train import train
from merap.strategies.registry import BELIEF
from scripts.bench.belief import chosen_conditions
from scripts.bench.following import CONDITIONS, UNDISTURBED, Lengths, NoiseCondition
from scripts.bench.strategy_quality import COMPARED, strategy_figures
from scripts.bench.tables import Json, cell, show, table, write_figures

MODELS = Path(__file__).parents[2] / "models"
CASES = (*(f"paper-grid/rq1-{number}.yaml" for number in range(1, 9)), "running-example")
EPISODES = "episodes_to_within_5_percent"
COLUMNS = {
    "case": "case",
    "outside": "outside",
    "strategy": "strategy",
    f"quantile_50_{EPISODES}": "median",
    f"quantile_95_{EPISODES}": "p95",
    f"never_{EPISODES}": "never",
    "mean_final_return": "final",
    "optimum": "best",
    "mean_first_episode_regret": "regret of first",
    "mean_cumulative_regret": "in use",
    "mean_sampled_regret": "sampled",
    "seconds_to_prepare": "s before",
    "seconds_per_seed": "s per seed",
}

Row = Mapping[str, Any]


def online(
    json_file: Json = None,
    case: Annotated[list[str] | None, typer.Option(help="Below models/; the nine shipped ones.")] = None,
    strategy: Annotated[list[str] | None, typer.Option(help="As of `merap adapt`; all.")] = None,
    condition: Annotated[
        list[str] | None, typer.Option(help="none, noise, slip or both; none, and all for `belief`.")
    ] = None,
    seeds: int = 30,
    max_episodes: int = 60,
    regret_episodes: int = 10,
    episodes_per_step: int = 5,
    training_seed: int = 0,
) -> None:
    """Count real episodes until within 5 percent, and regret of the first ten; `outside` is not in the base.

    A run ends with the third row in a row within 5 percent, but lasts as long as regret is summed. Regret
    is the optimum minus the value of the policy in use, or minus what was sampled, exploration included.
    """
    names = strategy or COMPARED
    lengths = Lengths(regret_episodes, max_episodes)
    chosen = [
        (one, [name for name in names if condition or one == UNDISTURBED or name == BELIEF])
        for one in (chosen_conditions(condition) if condition else CONDITIONS)
    ]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, path in enumerate(track(case or CASES, "cases")):
            study = load_case(MODELS / path)
            run = train(study, Path(folder) / str(number), TrainingConfig(seed=training_seed))
            for one, some in chosen:
                rows.extend(strategy_figures(run, some, one, range(seeds), lengths, episodes_per_step))
            write_figures(json_file, rows)
    tables = [_compared(rows, one) for one, some in chosen if len(some) > 1 or len(chosen) == 1]
    if len(chosen) > 1:
        tables.append(_disturbed(rows, [one.name for one, _ in chosen]))
    show(
        *tables,
        f"{seeds} seeds, at most {max_episodes} episodes, {episodes_per_step} for a gradient step; "
        f"regret in use and sampled: of {regret_episodes} episodes",
    )


def _compared(rows: Sequence[Row], condition: NoiseCondition) -> Table:
    """Build a row for each case and strategy under one condition."""
    some = [row for row in rows if row["condition"] == condition.name]
    return table(f"condition: {condition.name}", some, COLUMNS)


def _disturbed(rows: Sequence[Row], conditions: Sequence[str]) -> Table:
    """Build a row for each case and strategy under all conditions, a column for each condition."""
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for row in rows:
        figures = [row[f"{figure}_{EPISODES}"] for figure in ("quantile_50", "quantile_95", "never")]
        regrets = [row[f"mean_{figure}_regret"] for figure in ("first_episode", "cumulative", "sampled")]
        found = cells.setdefault((row["case"], row["strategy"]), {})
        found[row["condition"]] = f"{' / '.join(map(cell, figures))}\n{', '.join(map(cell, regrets))}"
    title = "median / p95 / never\nregret of the first, in use, sampled"
    built = Table("case", "strategy", *conditions, title=title, show_lines=True)
    for (case, strategy), found in cells.items():
        if len(found) == len(conditions):
            built.add_row(case, strategy, *(found[name] for name in conditions))
    return built
