"""`adapt`: from a trained run to an adapted policy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from merap.cli import options
from merap.cli.output import (
    counted,
    job,
    number,
    require_free_folder,
    require_free_report,
    say,
    table,
    warn,
    write_json,
)
from merap.concerns.arguments import as_seeds
from merap.errors import InputError

if TYPE_CHECKING:
    from merap.concerns.combination import Combination
    from merap.shield.learning_shield import ShieldSettings
    from merap.shield.safe_optimum import SafeOptimum
    from merap.strategies.adaptation import Adaptation, Spread

STRATEGY_HELP = (
    "belief plans on the models; gradient, the paper's, takes gradient steps; belief is the default where "
    "the models know but locations and modes, else gradient; to compare with: ope, "
    "retrieval, joint, oracle or pretrained:<combination>; pretrained:all shows the best, the median and "
    "the worst of the base."
)
DEFAULT_EPISODES, DEFAULT_STEPS = 35, 30
REPORT = "report.json"
FILES = (REPORT, *(f"{name}.{kind}" for name in ("curve", "map") for kind in ("png", "svg")))
SHOWN_STEPS = (0, 1, 2, 3, 5, 10, 20, 30, 50, 100)


def register(app: typer.Typer) -> None:
    """Add this verb."""
    app.command()(adapt)


def adapt(
    run: Annotated[Path, typer.Argument(help="Folder of a training run.", show_default=False)],
    system: options.SystemName = None,
    strategy: Annotated[str | None, typer.Option(help=STRATEGY_HELP)] = None,
    episodes_per_step: Annotated[
        int | None,
        typer.Option(
            min=1, help="Real episodes of a step of gradient and ope, 35 by default; others take 1."
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Policy updates; 30 by default.")] = None,
    max_episodes: Annotated[
        int | None, typer.Option(min=1, help="Real episodes at most, in place of --steps.")
    ] = None,
    seeds: Annotated[str, typer.Option(help="a:b for seeds a to b - 1, or one seed.")] = "0:1",
    reward_noise: options.RewardNoise = 0.0,
    slip: options.Slip = 0.0,
    reset: options.Reset = None,
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
        Path | None,
        typer.Option("--out", "-o", help="Folder for the report, and curve and map as PNG and SVG."),
    ] = None,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Adapt to a system that is met online, and score it against the optimum."""
    from merap.families.build import cut_off_warnings
    from merap.runs.run_folder import read_run
    from merap.strategies import adaptation
    from merap.strategies.problem import Conditions, adaptation_problem
    from merap.strategies.registry import ALL, PRETRAINED, default_strategy, parse_strategy

    require_free_report(json, force=force)
    if out is not None:
        require_free_folder(out, FILES, force=force)
    if strategy is not None:
        parse_strategy(strategy)
    opened = read_run(run)
    warn(opened.warnings)
    default, notices = default_strategy(opened.case)
    if strategy is None:
        strategy = default
        warn(notices)
    spread = parse_strategy(strategy) == (PRETRAINED, ALL)
    each, steps = _lengths(strategy, episodes_per_step, steps, max_episodes)
    chosen = as_seeds(seeds, "--seeds")
    problem = adaptation_problem(
        opened,
        options.chosen_system(opened.case, system),
        episodes_per_step=each,
        conditions=Conditions(reward_noise, slip, reset),
        shield=_shield(shield, hazard_prior),
    )
    warn(cut_off_warnings(problem.truth.system))
    report: Adaptation | Spread
    with job("Adapting", len(chosen) * steps * (3 if spread else 1)) as bar:
        if spread:
            report = adaptation.spread_of_pretrained(problem, steps=steps, seeds=chosen, on_step=bar.advance)
        else:
            report = adaptation.adapt_to(problem, strategy, steps=steps, seeds=chosen, on_step=bar.advance)
    shown = report.shown if isinstance(report, adaptation.Spread) else (report,)
    write_json(json, report.as_dict(), force=force)
    if out is not None:
        write_json(out / REPORT, report.as_dict(), force=force)
        _draw(shown, problem.truth.system, opened.case.name, out, force=force)
    if str(json) != "-":
        for found in shown:
            _show(found)
    warn(line for found in shown for line in _advice(found, default))


def _lengths(
    strategy: str, episodes_per_step: int | None, steps: int | None, max_episodes: int | None
) -> tuple[int, int]:
    """Return the real episodes of a gradient step, and the number of policy updates."""
    from merap.strategies.registry import STEPPING, episodes_per_update, parse_strategy

    kind, _ = parse_strategy(strategy)
    if episodes_per_step is not None and kind not in STEPPING:
        warn([f"--episodes-per-step is of {' and '.join(STEPPING)} alone: {kind} takes 1 episode each"])
    each = DEFAULT_EPISODES if episodes_per_step is None else episodes_per_step
    if max_episodes is None:
        return each, DEFAULT_STEPS if steps is None else steps
    if steps is not None:
        raise InputError("--steps says how long already; give one of the two", source="--max-episodes")
    needed = episodes_per_update(strategy, each)
    if max_episodes < needed:
        raise InputError(
            f"a step of {kind} takes {needed} real episodes, so {max_episodes} are too few for one; give at "
            f"least {needed}, or fewer by --episodes-per-step",
            source="--max-episodes",
        )
    return each, max_episodes // needed


def _shield(threshold: float | None, hazard_prior: float) -> ShieldSettings | None:
    if threshold is None:
        if hazard_prior:
            raise InputError("a prior on hazards needs a shield: give --shield too", source="--hazard-prior")
        return None
    from merap.shield.learning_shield import ShieldSettings

    return ShieldSettings(threshold, hazard_prior)


def _show(found: Adaptation) -> None:
    """Show the mean curve at some steps, then the scores."""
    say(f"{found.strategy} on {found.system}, {counted(len(found.runs), 'seed')}")
    curves = [run.curve for run in found.runs]
    rows = []
    last = len(curves[0]) - 1
    for step in [*(step for step in SHOWN_STEPS if step < last), last]:
        values = [curve[step].expected_return for curve in curves]
        mean = sum(values) / len(values)
        cells = (mean, min(values), max(values))
        rows.append((str(step), str(curves[0][step].episodes), *(number(cell, 4) for cell in cells)))
    table(("step", "episodes", "expected return", "least", "greatest"), rows)
    scores: dict[str, Any] = found.as_dict()["summary"]
    say(f"optimum {number(found.reachable.optimum)}, worst {number(found.reachable.worst)}")
    if found.within_shield is not None:
        _show_within(found.within_shield)
    _show_speed(scores)
    if scores["too_short"]:
        say(
            f"too short to tell: {scores['too_short']} of {scores['runs']} runs; three rows in a row must be "
            "within 5 percent, so give more --steps or --max-episodes"
        )
    first, total, sampled = (
        number(round(scores[f"mean_{kind}_regret"], 9) + 0.0, 4)
        for kind in ("first_episode", "cumulative", "sampled")
    )
    say(f"regret: {first} in the first episode, {total} in all; what the episodes really lost: {sampled}")
    say(f"seed {found.runs[0].seed}, at the end:")
    for line in found.reasons[0][-1]:
        say(f"  {line}")
    if found.safety:
        _show_safety(found.as_dict()["safety"]["total"])


def _show_speed(scores: Mapping[str, Any]) -> None:
    """Say how soon the runs came within 5 percent of the optimum."""
    runs, steps = scores["runs"], scores["mean_steps_to_within_5_percent"]
    never = f"never: {scores['never_steps_to_within_5_percent'] - scores['too_short']} of {runs} runs"
    if steps is None:
        say(f"not within 5 percent of the optimum for three updates in a row; {never}")
        return
    after = counted(float(number(steps, 3)), "step")
    episodes = counted(float(number(scores["mean_episodes_to_within_5_percent"], 3)), "episode")
    say(f"within 5 percent after {after} on average ({episodes}); {never}")
    half, most = (scores[f"quantile_{percent}_episodes_to_within_5_percent"] for percent in (50, 95))
    if half is not None:
        rest = "" if most is None else f", 95 percent within {number(most, 3)}"
        say(f"half of the runs within {counted(half, 'episode')}{rest}")


def _advice(found: Adaptation, default: str) -> Iterator[str]:
    """Say what to try where a strategy got nowhere; `default` is the best for the case."""
    from merap.strategies.registry import GRADIENT, ORACLE, parse_strategy

    if found.reachable.nothing_at_stake:
        yield f"every policy earns the same on {found.system}: there is nothing to learn there"
        return
    scores = found.as_dict()["summary"]
    kind, _ = parse_strategy(found.strategy)
    never = scores["never_steps_to_within_5_percent"] == scores["runs"] and not scores["too_short"]
    if never and kind != ORACLE:
        more = (
            "more --max-episodes" if default == GRADIENT else f"more --max-episodes, or --strategy {GRADIENT}"
        )
        other = more if kind == default else f"--strategy {default}"
        yield (
            f"{found.strategy} got nowhere near the optimum: none of {counted(scores['runs'], 'run')} came "
            f"within 5 percent; try {other}"
        )


def _show_within(possible: SafeOptimum) -> None:
    """Say how much can be earned within the shield's threshold."""
    line = f"within the shield's threshold at most {number(possible.value)} can be earned"
    if possible.completed == 0:
        line += ", and the task can't be completed: there is no way to do it as safely as that"
    say(line)


def _show_safety(sums: Mapping[str, Any]) -> None:
    episodes = sums["episodes"]
    say(f"violations: {sums['violations']} of {episodes} episodes; ended: {sums['completed']}")
    shield = sums["shield"]
    if shield is not None:
        say(
            f"shield at {shield['threshold']:g}: {shield['withheld']} actions withheld in {shield['steps']} "
            f"steps; nothing within the budget, so the least risky: {shield['fallbacks']} steps; beyond it "
            f"from the start: {shield['beyond_from_start']} episodes"
        )


def _draw(shown: Sequence[Adaptation], system: Combination, case: str, folder: Path, *, force: bool) -> None:
    """Draw the curves of all, and the map of the first; without a map tell its paths."""
    from merap.report.curves import draw_adaptation
    from merap.report.map import draw_before_after, has_map
    from merap.report.path import most_likely_path
    from merap.report.saving import save_figure

    found = shown[0]
    curves = {one.strategy: [[row.expected_return for row in run.curve] for run in one.runs] for one in shown}
    title = f"{case}: adaptation to {found.system}"
    optimum, worst = found.reachable.optimum, found.reachable.worst
    paths = [
        most_likely_path(found.model, system, policy, system.objective.horizon, label=label)
        for policy, label in ((found.before, "before"), (found.after, "after"))
    ]
    written = [*save_figure(draw_adaptation(curves, optimum, worst, title), folder / "curve", force=force)]
    if has_map(system):
        written += save_figure(draw_before_after(system, *paths, title=title), folder / "map", force=force)
    else:
        for path in paths:
            say(f"path {path.label}: {path.text}")
    say("wrote " + ", ".join(str(path) for path in written))
