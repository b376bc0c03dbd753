"""Measure merap: scripts.bench export | learning | growth | adaptation | online | belief | trigger |
shield | program | foreign FOLDER [--json FILE].

Ratios are of things timed side by side in one run.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from itertools import chain
from pathlib import Path

import typer

from merap.checker.storm import build_text
from merap.checker.storm_model import StormModel
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.runs.train import train
from merap.strategies.adaptation import adapt
from scripts.bench import belief, foreign, growth, learning, online, program, shield, trigger
from scripts.bench.learning import median, report
from scripts.bench.program import GRID, export_mapped
from scripts.bench.tables import Json

ROOT = Path(__file__).parents[2]
EPISODES_PER_STEP = (35, 10, 5)

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)

app.command()(learning.learning)
app.command()(growth.growth)
app.command()(online.online)
app.add_typer(belief.app, name="belief")
app.command()(trigger.trigger)
app.command()(shield.shield)
app.command()(program.program)
app.command()(foreign.foreign)


@app.callback()
def bench() -> None:
    """Measure in seconds; quote the ratios."""


@app.command()
def export(json_file: Json = None, size: int = 300, repeats: int = 5) -> None:
    """Time Storm's model as arrays: UMB mapped into memory against iterating rows, and against building."""
    text = GRID.format(size=size)
    model = build_text(text, "grid")
    mdp = model.mdp()
    seconds = {
        "build": median(lambda: build_text(text, "grid"), repeats),
        "export_umb": median(lambda: export_mapped(model), repeats),
        "iterate_rows": median(lambda: _iterate(model), 1),
    }
    figures = {
        "states": mdp.num_states,
        "choices": mdp.num_choices,
        "branches": mdp.num_branches,
        **{f"seconds_{name}": value for name, value in seconds.items()},
        "iterate_over_export": seconds["iterate_rows"] / seconds["export_umb"],
        "export_over_build": seconds["export_umb"] / seconds["build"],
    }
    report("export", figures, json_file)


@app.command()
def adaptation(
    json_file: Json = None,
    case: Path = ROOT / "models" / "paper-grid" / "rq1-1.yaml",
    training_seeds: int = 5,
    seeds: int = 20,
) -> None:
    """Time training, and count gradient steps until an online system is within 5 percent."""
    study = load_case(case)
    figures: dict[str, float] = {}
    rows: dict[int, list[list[int | None]]] = {episodes: [] for episodes in EPISODES_PER_STEP}
    seconds = []
    for seed in range(training_seeds):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            run = train(study, Path(folder) / "run", TrainingConfig(seed=seed))
            seconds.append(time.perf_counter() - begin)
            for episodes in EPISODES_PER_STEP:
                found = adapt(
                    run,
                    study.system("met"),
                    strategy="gradient",
                    episodes_per_step=episodes,
                    seeds=range(seeds),
                )
                rows[episodes].append([one.steps_to_within_5_percent for one in found.runs])
    figures["training_seconds_median"] = statistics.median(seconds)
    figures["training_seconds_max"] = max(seconds)
    for episodes, by_seed in rows.items():
        reached = [[steps for steps in of_seed if steps is not None] for of_seed in by_seed]
        figures[f"steps_mean_{episodes}_episodes"] = statistics.mean(chain.from_iterable(reached))
        figures[f"steps_worst_training_seed_{episodes}_episodes"] = max(
            statistics.mean(steps) for steps in reached
        )
        figures[f"never_{episodes}_episodes"] = sum(of_seed.count(None) for of_seed in by_seed)
    figures["runs"] = training_seeds * seeds
    report(f"adaptation to {study.name}", figures, json_file)


def _iterate(model: StormModel) -> tuple[list[int], list[float]]:
    """Export the obvious way: every transition as a Python object."""
    targets, probabilities = [], []
    for state in model.model.states:
        for action in state.actions:
            for transition in action.transitions:
                targets.append(transition.column)
                probabilities.append(transition.value)
    return targets, probabilities


if __name__ == "__main__":
    app()
