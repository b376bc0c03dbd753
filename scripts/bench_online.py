"""Every adaptation strategy on the paper's eight cases: bench.py online [--json FILE].

`belief` on many more cases: bench_belief.py.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from merap.concerns.case_study import load_case
from merap.experiments.belief_quality import CONDITIONS
from merap.experiments.strategy_quality import COMPARED, strategy_figures
from merap.learning.config import TrainingConfig
from merap.learning.running import train

MODELS = Path(__file__).parents[1] / "models"
CASES = tuple(f"paper-grid/rq1-{number}.yaml" for number in range(1, 9))
WIDTH = 140
EPISODES = "episodes_to_within_5_percent"
COLUMNS = {
    "case": "case",
    "condition": "condition",
    "outside": "outside",
    "strategy": "strategy",
    f"quantile_50_{EPISODES}": "median",
    f"quantile_95_{EPISODES}": "p95",
    f"never_{EPISODES}": "never",
    "mean_final_return": "final return",
    "mean_first_episode_regret": "first regret",
    "mean_cumulative_regret": "regret",
    "mean_sampled_regret": "sampled regret",
    "seconds_per_seed": "s per seed",
}


def online(
    json_file: Annotated[Path | None, typer.Option("--json", help="Write all rows.")] = None,
    case: Annotated[list[str] | None, typer.Option(help="Below models/; RQ1-1 to 8.")] = None,
    strategy: Annotated[list[str] | None, typer.Option(help="As of `merap adapt`; all.")] = None,
    condition: Annotated[list[str] | None, typer.Option(help="none, noise, slip or both; none.")] = None,
    seeds: int = 30,
    max_episodes: int = 60,
    episodes_per_step: int = 5,
    training_seed: int = 0,
) -> None:
    """Real episodes until within 5 percent, and regret, of every strategy; `outside` is not in the base."""
    known = {one.name: one for one in CONDITIONS}
    for name in condition or ():
        if name not in known:
            raise typer.BadParameter(f"there is no condition {name!r}; allowed: {', '.join(known)}")
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, path in enumerate(track(case or CASES, "cases")):
            study = load_case(MODELS / path)
            run = train(study, Path(folder) / str(number), TrainingConfig(seed=training_seed))
            for name in condition or ("none",):
                figures = strategy_figures(
                    run, strategy or COMPARED, known[name], range(seeds), max_episodes, episodes_per_step
                )
                rows.extend(figures)
    _report(f"{seeds} seeds, at most {max_episodes} episodes, {episodes_per_step} for a gradient step", rows)
    if json_file is not None:
        json_file.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def _report(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    table = Table(*COLUMNS.values(), title=title)
    for row in rows:
        table.add_row(*(_shown(row[name]) for name in COLUMNS))
    console = Console()
    console.width = max(console.width, WIDTH)
    console.print(table)


def _shown(value: object) -> str:
    if value is None:
        return "never"
    return f"{value:.3g}" if isinstance(value, float) else f"{value}"
