"""`train`, `adapt`: from checked models to an adapted policy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from merap.cli import options
from merap.cli.output import job_bar, number, require_free_report, say, table, warn, write_json
from merap.concerns.case_study import load_case
from merap.concerns.combination import ResetMode
from merap.errors import InputError

if TYPE_CHECKING:
    from merap.learning.metrics import UpdateMetrics
    from merap.learning.training import Outcome
    from merap.online.adaptation import Adaptation, Spread
    from merap.online.shield.learning_shield import ShieldSettings

SEED_LIMIT = 2**63
STRATEGY_HELP = (
    "gradient, belief, ope, retrieval, joint, oracle or pretrained:<combination>; "
    "pretrained:all shows the best, the median and the worst of the base."
)
SHOWN_STEPS = (0, 1, 2, 3, 5, 10, 20, 30, 50, 100)


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(train)
    app.command()(adapt)


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


def adapt(
    run: Annotated[Path, typer.Argument(help="Folder of a training run.", show_default=False)],
    system: options.SystemName = "met",
    strategy: Annotated[str, typer.Option(help=STRATEGY_HELP)] = "gradient",
    episodes_per_step: Annotated[
        int, typer.Option(min=1, help="Real episodes of a step of gradient and ope; others take one.")
    ] = 35,
    steps: Annotated[int, typer.Option(min=1, help="Policy updates.")] = 30,
    max_episodes: Annotated[
        int | None, typer.Option(min=1, help="Real episodes at most, in place of --steps.")
    ] = None,
    seeds: Annotated[str, typer.Option(help="a:b for seeds a to b - 1, or one seed.")] = "0:1",
    reward_noise: Annotated[
        float, typer.Option(min=0, metavar="SD", help="Deviation of Gaussian noise on rewards.")
    ] = 0.0,
    slip: Annotated[
        float, typer.Option(min=0, max=1, metavar="P", help="Probability that an action does nothing.")
    ] = 0.0,
    reset: Annotated[
        ResetMode | None, typer.Option(help="How an episode begins, in place of what the case says.")
    ] = None,
    shield: Annotated[
        float | None,
        typer.Option(
            help="Largest probability to ever reach an unsafe state in an episode; no shield if left out."
        ),
    ] = None,
    hazard_prior: Annotated[
        float,
        typer.Option(help="Probability of a location to be unsafe though no model says so; with --shield."),
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for curve and map, as PNG and SVG.")
    ] = None,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Adapt to a system that is met online, and score it against the optimum."""
    from merap.learning.run_folder import read_run
    from merap.online import adaptation
    from merap.online.encounter import Conditions, encounter
    from merap.online.strategies.registry import ALL, PRETRAINED, episodes_per_update, parse_strategy

    require_free_report(json, force=force)
    spread = parse_strategy(strategy) == (PRETRAINED, ALL)
    if max_episodes is not None:
        steps = max_episodes // episodes_per_update(strategy, episodes_per_step)
    opened = read_run(run)
    chosen = _seeds(seeds)
    met = encounter(
        opened,
        opened.case.system(system),
        episodes_per_step=episodes_per_step,
        conditions=Conditions(reward_noise, slip, reset),
        shield=_shield(shield, hazard_prior),
    )
    report: Adaptation | Spread
    with job_bar() as bar:
        job = bar.add_task("Adapting", total=len(chosen) * steps * (3 if spread else 1), note="")

        def count() -> None:
            bar.advance(job)

        if spread:
            report = adaptation.spread_of_pretrained(met, steps=steps, seeds=chosen, on_step=count)
        else:
            report = adaptation.adapt_to(met, strategy, steps=steps, seeds=chosen, on_step=count)
    shown = report.shown if isinstance(report, adaptation.Spread) else (report,)
    write_json(json, report.as_dict(), force=force)
    if out is not None:
        _draw(shown, met.system, out, force=force)
    if str(json) != "-":
        for found in shown:
            _show(found)


def _shield(threshold: float | None, hazard_prior: float) -> ShieldSettings | None:
    if threshold is None:
        if hazard_prior:
            raise InputError("a prior on hazards needs a shield: give --shield too", source="--hazard-prior")
        return None
    from merap.online.shield.learning_shield import ShieldSettings

    return ShieldSettings(threshold, hazard_prior)


def _seeds(text: str) -> range:
    first, colon, end = text.partition(":")
    if not (first.isdecimal() and (end.isdecimal() if colon else not end)):
        raise InputError(f"expected a:b with whole numbers or one seed, got {text!r}", source="--seeds")
    seeds = range(int(first), int(end) if colon else int(first) + 1)
    if not seeds:
        raise InputError(f"{text!r} holds no seed", source="--seeds")
    if seeds.stop > SEED_LIMIT:
        raise InputError(f"seeds must be below {SEED_LIMIT}, got {text!r}", source="--seeds")
    return seeds


def _show(found: Adaptation) -> None:
    """The mean curve at some steps, then the scores."""
    say(f"{found.strategy}, {len(found.runs)} seeds")
    curves = [run.curve for run in found.runs]
    rows = []
    for step in [step for step in SHOWN_STEPS if step < len(curves[0])]:
        values = [curve[step].expected_return for curve in curves]
        mean = sum(values) / len(values)
        cells = (mean, min(values), max(values))
        rows.append((str(step), str(curves[0][step].episodes), *(number(cell, 4) for cell in cells)))
    table(("step", "episodes", "expected return", "least", "greatest"), rows)
    scores: dict[str, Any] = found.as_dict()["summary"]
    say(f"optimum {number(found.reachable.optimum)}, worst {number(found.reachable.worst)}")
    say(
        f"within 5 percent after {number(scores['mean_steps_to_within_5_percent'], 3)} steps on average "
        f"({number(scores['mean_episodes_to_within_5_percent'], 3)} episodes); "
        f"never: {scores['never_steps_to_within_5_percent']} of {scores['runs']} runs"
    )
    half, most = (
        number(scores[f"quantile_{percent}_episodes_to_within_5_percent"], 3) for percent in (50, 95)
    )
    say(f"half of the runs within {half} episodes, 95 percent within {most}")
    first, total, sampled = (
        number(scores[f"mean_{kind}_regret"], 4) for kind in ("first_episode", "cumulative", "sampled")
    )
    say(f"regret: {first} in the first episode, {total} in all; what the episodes really lost: {sampled}")
    say(f"seed {found.runs[0].seed}, at the end:")
    for line in found.reasons[-1]:
        say(f"  {line}")
    if found.safety:
        _show_safety(found.as_dict()["safety"]["total"])


def _show_safety(sums: Mapping[str, Any]) -> None:
    episodes = sums["episodes"]
    say(f"violations: {sums['violations']} of {episodes} episodes; completed: {sums['completed']}")
    shield = sums["shield"]
    if shield is not None:
        say(
            f"shield at {shield['threshold']:g}: {shield['withheld']} actions withheld in {shield['steps']} "
            f"steps; nothing within the budget, so the least risky: {shield['fallbacks']} steps; beyond it "
            f"from the start: {shield['beyond_from_start']} episodes"
        )


def _draw(shown: Sequence[Adaptation], met: Any, folder: Path, *, force: bool) -> None:
    """The curves of all, and the map of the first."""
    from merap.report.curves import draw_adaptation
    from merap.report.map import draw_before_after
    from merap.report.path import most_likely_path
    from merap.report.saving import save_figure

    found = shown[0]
    curves = {one.strategy: [[row.expected_return for row in run.curve] for run in one.runs] for one in shown}
    title = f"Adaptation to {found.system}"
    optimum, worst = found.reachable.optimum, found.reachable.worst
    paths = [
        most_likely_path(found.model, met, policy, met.objective.horizon, label=label)
        for policy, label in ((found.before, "before"), (found.after, "after"))
    ]
    written = [
        *save_figure(draw_adaptation(curves, optimum, worst, title), folder / "curve", force=force),
        *save_figure(draw_before_after(met, *paths), folder / "map", force=force),
    ]
    say("wrote " + ", ".join(str(path) for path in written))
