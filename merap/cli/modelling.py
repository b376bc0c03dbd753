"""`render`, `verify`, `export`: from a case to checked models."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from merap.checker.properties import TIMEOUT
from merap.cli import options
from merap.cli.output import counted, number, progress, require_free_report, say, table, warn, write_json
from merap.concerns.case_study import DEFAULT_LIMIT, CaseStudy
from merap.concerns.combination import Combination
from merap.errors import EngineError, InputError
from merap.families.loading import load_case

if TYPE_CHECKING:
    from merap.checker.verdicts import Verdict

FALSE_VERDICT = 1


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(render)
    app.command()(verify)
    app.command()(export)


def render(
    case: options.Case, out: options.Out, sample: options.Sample = None, seed: options.Seed = 0
) -> None:
    """Write one <combination>.prism each, and manifest.json."""
    from merap.families.writing import render_case

    study = load_case(case)
    count = render_case(study, _chosen(study, sample, seed, "Rendering"), out)
    say(f"{counted(count, 'model')} in {out}")


def export(
    case: options.Case, out: options.Out, sample: options.Sample = None, seed: options.Seed = 0
) -> None:
    """Build each combination with Storm and write it as UMB, a format other checkers read."""
    from merap.families.writing import export_case

    study = load_case(case)
    count = export_case(study, _chosen(study, sample, seed, "Exporting"), out)
    say(f"{counted(count, 'model')} in {out}")


def verify(
    case: options.Case,
    name: Annotated[str | None, typer.Option("--property", help="Check only this property.")] = None,
    sample: options.Sample = None,
    seed: options.Seed = 0,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="Limit for a model and for each property.")
    ] = TIMEOUT,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Build every combination with Storm and check its properties.

    Exits with 1 if a verdict is false, and says what cuts the goal off; else with 3 if a property
    has no answer within the time limit.
    """
    from merap.checker.verdicts import verify as verify_combinations

    require_free_report(json, force=force)
    study = load_case(case)
    warn(study.warnings)
    verdicts = list(verify_combinations(_chosen(study, sample, seed, "Verifying"), name, timeout=timeout))
    write_json(
        json, {"case": study.name, "verdicts": [verdict.as_dict() for verdict in verdicts]}, force=force
    )
    if str(json) != "-":
        _show(verdicts)
    if any(verdict.holds is False for verdict in verdicts):
        raise typer.Exit(FALSE_VERDICT)
    if any(verdict.status == "timeout" for verdict in verdicts):
        raise typer.Exit(EngineError.exit_code)


def _chosen(study: CaseStudy, sample: int | None, seed: int, what: str) -> Iterable[Combination]:
    if sample is None or sample >= study.size:
        if study.size > DEFAULT_LIMIT:
            raise InputError(
                f"{study.name} has {study.size} combinations, too many to enumerate (limit {DEFAULT_LIMIT}); "
                "take some at random, such as --sample 100",
                source=str(study.source),
            )
        return progress(study.combinations(), study.size, what)
    return progress(study.sample(sample, np.random.default_rng(seed)), sample, what)


def _show(verdicts: list[Verdict]) -> None:
    """Show a row for each combination, a column for each property; then false verdicts and their reasons."""
    names = list(dict.fromkeys(verdict.name for verdict in verdicts))
    cells: dict[str, dict[str, str]] = {}
    for verdict in verdicts:
        cells.setdefault(verdict.combination, {})[verdict.name] = _cell(verdict)
    table(
        ("combination", *names),
        [(combination, *(row.get(name, "") for name in names)) for combination, row in cells.items()],
    )
    false = [verdict for verdict in verdicts if verdict.holds is False]
    for verdict in false:
        say(f"{verdict.combination}: {verdict.name} ({verdict.property}) does not hold: {verdict.reason}")
    unanswered = [verdict for verdict in verdicts if verdict.status != "ok"]
    for line in dict.fromkeys(f"{verdict.status}: {verdict.reason}" for verdict in unanswered):
        say(line)
    unknown = f", {len(unanswered)} without an answer" if unanswered else ""
    counts = f"{counted(len(cells), 'combination')}, {counted(len(verdicts), 'verdict')}"
    say(f"{counts}, {len(false)} false{unknown}")


def _cell(verdict: Verdict) -> str:
    if verdict.status != "ok":
        return verdict.status
    if verdict.value is not None:
        return number(verdict.value) + (" FALSE" if verdict.holds is False else "")
    return "FALSE" if verdict.holds is False else "true"
