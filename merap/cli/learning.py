"""`train`: from checked models to a meta policy."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from merap.cli.interruption import go_on_with
from merap.cli.output import counted, job, number, say, warn
from merap.errors import InputError
from merap.families.folder import MANIFEST
from merap.families.loading import load_case

if TYPE_CHECKING:
    from merap.learning.progress import UpdateMetrics
    from merap.learning.training import TrainingOutcome
    from merap.runs.run_folder import RunFolder


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
    resume: Annotated[
        bool, typer.Option(help="Go on with the run in this folder; with --updates to more of them.")
    ] = False,
) -> None:
    """Learn a meta policy over the model base of a case."""
    from merap.runs.train import train_run

    given = {
        "seed": seed,
        "updates": updates,
        "estimator": estimator,
        "outer_repeats": outer_repeats,
        "tensorboard": tensorboard or None,
    }
    if resume:
        others = case or config or source or settings
        if others or any(value is not None for name, value in given.items() if name != "updates"):
            raise InputError(
                "--resume goes on with the run's own case and settings, of which only --updates may grow",
                source="merap train",
            )
        run = _resumed(out, updates)
    elif case is None:
        raise InputError("a case is missing; see merap train --help", source="merap train")
    else:
        run = _begun(out, case, config, settings or [], source, given)
    warn(run.warnings)
    seconds: list[float] = []

    def show(metrics: UpdateMetrics) -> None:
        seconds.append(metrics.seconds)
        rate = len(seconds) / sum(seconds)
        bar.advance(metrics.update, f"{rate:.0f}/s, adapted return {metrics.adapted_return:.3f}")

    with job("Training", run.config.updates) as bar:
        outcome = train_run(run, show).outcome
    say(
        f"{counted(len(run.names), 'task')}, {counted(len(seconds), 'update')} in {sum(seconds):.1f} s; "
        f"the run is in {run.path}"
    )
    warn(_remarks(outcome))
    _show_result(run)


def _begun(
    out: Path,
    case: Path,
    config: Path | None,
    settings: Sequence[str],
    source: Path | None,
    given: Mapping[str, Any],
) -> RunFolder:
    """Make the folder of a new run."""
    from merap.runs.run_folder import read_run
    from merap.runs.settings import read_config
    from merap.runs.train import begin_run

    study = load_case(case)
    warn(study.warnings)
    begun_from = None if source is None else read_run(source)
    chosen = read_config(config, settings, None if begun_from is None else begun_from.config, **given)
    _go_on_with(out)
    with job("Building models", min(study.size, chosen.max_tasks)) as bar:
        return begin_run(out, study, chosen, begun_from, bar.advance)


def _resumed(out: Path, updates: int | None) -> RunFolder:
    """Open the folder of a run that goes on."""
    from merap.runs.run_folder import read_run
    from merap.runs.train import lengthen

    run = read_run(out)
    _go_on_with(out)
    return run if updates is None else lengthen(run, updates)


def _go_on_with(out: Path) -> None:
    from merap.runs.run_folder import resume_command

    go_on_with(resume_command(out), when=(out / MANIFEST).exists)


def _show_result(run: RunFolder) -> None:
    """Say what the adapted policies are worth, and warn where that is little."""
    from merap.belief.steps import beyond_places_and_modes
    from merap.strategies.training_result import evaluate_training

    found = evaluate_training(run)
    say(
        f"after {counted(run.config.inner_steps, 'gradient step')} of "
        f"{counted(run.config.episodes, 'episode')} the adapted policies return "
        f"{number(found.adapted.mean(), 4)} on average over {counted(len(found.names), 'task')}; "
        f"the best possible is {number(found.optimum.mean(), 4)}"
    )
    if found.far_from_optimum:
        plan = ""
        if beyond_places_and_modes(run.case.combination_at(0)) is None:
            plan = f", or plan on the models: merap adapt {shlex.quote(str(run.path))} --strategy belief"
        warn(
            [
                f"little was learned: over acting at random the adapted policies gain {found.gain:.0%} of "
                f"what the best ones do; try more --updates{plan}"
            ]
        )
    if found.never_ends:
        warn(["no adapted policy ever completes its task: each goes on until the horizon"])


def _remarks(outcome: TrainingOutcome) -> Iterator[str]:
    """Return remarks on how training ended."""
    if outcome.collapsed:
        yield (
            f"the adapted return has collapsed, from {number(outcome.best_score, 4)} to "
            f"{number(outcome.last_score, 4)}; the policy of update {outcome.kept} is kept"
        )
    elif outcome.stopped:
        yield f"the adapted return has reached a plateau; training stopped after update {outcome.updates}"
