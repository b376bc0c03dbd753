"""`train`: from checked models to a meta policy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from merap.cli.output import job_bar, number, say, warn
from merap.concerns.case_study import load_case
from merap.errors import InputError

if TYPE_CHECKING:
    from merap.learning.metrics import UpdateMetrics
    from merap.learning.training import Outcome


def register(app: typer.Typer) -> None:
    """Add this verb."""
    app.command()(train)


def train(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the run.", show_default=False)],
    case: Annotated[
        Path | None, typer.Argument(help="A case file or folder; not with --resume.", show_default=False)
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of everything random.")] = None,
    updates: Annotated[int | None, typer.Option(help="Outer updates.")] = None,
    estimator: Annotated[
        str | None,
        typer.Option(help="exact: gradients through the known models; sampled: the paper's Algorithm 1."),
    ] = None,
    outer_repeats: Annotated[int | None, typer.Option(help="Outer steps for each update.")] = None,
    config: Annotated[Path | None, typer.Option(help="A YAML file of settings.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="key=value for any setting; may be repeated.")
    ] = None,
    tensorboard: Annotated[bool, typer.Option(help="Also write metrics for TensorBoard.")] = False,
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="A finished run to begin with, as when a case was extended; its settings hold where none "
            "are given.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option(help="Go on with the run in this folder.")] = False,
) -> None:
    """Learn a meta policy over the model base of a case."""
    from merap.learning import running
    from merap.learning.run_folder import read_run
    from merap.learning.settings import read_config

    given = {
        "seed": seed,
        "updates": updates,
        "estimator": estimator,
        "outer_repeats": outer_repeats,
        "tensorboard": tensorboard or None,
    }
    if resume:
        if (
            case is not None
            or config is not None
            or source is not None
            or settings
            or any(value is not None for value in given.values())
        ):
            raise InputError(
                "--resume goes on with the run's own case and settings: merap train -o RUN --resume",
                source="merap train",
            )
        run = read_run(out)
    else:
        if case is None:
            raise InputError("a case is missing", source="merap train")
        study = load_case(case)
        warn(study.warnings)
        begun = None if source is None else read_run(source)
        chosen = read_config(config, settings or [], None if begun is None else begun.config, **given)
        run = running.begin_run(out, study, chosen, begun)
    seconds: list[float] = []

    def show(metrics: UpdateMetrics) -> None:
        seconds.append(metrics.seconds)
        note = f"{len(seconds) / sum(seconds):.0f}/s, adapted return {metrics.adapted_return:.3f}"
        bar.update(job, completed=metrics.update, note=note)

    with job_bar() as bar:
        job = bar.add_task("Training", total=run.config.updates, note="")
        outcome = running.train_run(run, show).outcome
    say(f"{len(run.names)} tasks, {len(seconds)} updates in {sum(seconds):.1f} s; the run is in {run.path}")
    warn(_remarks(outcome))


def _remarks(outcome: Outcome) -> Iterator[str]:
    """What is worth knowing of how training ended."""
    if outcome.collapsed:
        yield (
            f"the adapted return has collapsed, from {number(outcome.best_score, 4)} to "
            f"{number(outcome.last_score, 4)}; the policy of update {outcome.kept} is kept"
        )
    elif outcome.stopped:
        yield f"the adapted return has reached a plateau; training stopped after update {outcome.updates}"
