"""`render`, `verify`, `export`: from a case to checked models."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from merap.base.writing import export_case, render_case
from merap.checker.verdicts import Verdict
from merap.checker.verdicts import verify as verify_combinations
from merap.cli import options
from merap.cli.output import number, progress, say, table, warn, write_json
from merap.concerns.case_study import CaseStudy, load_case
from merap.concerns.combination import Combination

FALSE_VERDICT = 1


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(render)
    app.command()(verify)
    app.command()(export)


def render(case: options.Case, out: options.Out, sample: options.Sample = None, seed: options.Seed = 0) -> None:
    """Write one <combination>.prism each, and manifest.json."""
    study = load_case(case)
    count = render_case(study, _chosen(study, sample, seed, "Rendering"), out)
    say(f"{count} models in {out}")


def export(case: options.Case, out: options.Out, sample: options.Sample = None, seed: options.Seed = 0) -> None:
    """Build each combination with Storm and write it as UMB, a format other checkers read."""
    study = load_case(case)
    count = export_case(study, _chosen(study, sample, seed, "Exporting"), out)
    say(f"{count} models in {out}")


def verify(
    case: options.Case,
    name: Annotated[str | None, typer.Option("--property", help="Check only this property.")] = None,
    sample: options.Sample = None,
    seed: options.Seed = 0,
    json: options.Json = None,
    force: options.Force = False,
) -> int:
    """Build every combination with Storm and check its properties.

    Exits with 1 if a verdict is false, and says what cuts the goal off.
    """
    study = load_case(case)
    warn(study.warnings)
    verdicts = list(verify_combinations(_chosen(study, sample, seed, "Verifying"), name))
    write_json(json, {"case": study.name, "verdicts": [verdict.as_dict() for verdict in verdicts]}, force=force)
    if str(json) != "-":
        _show(verdicts)
    return FALSE_VERDICT if any(verdict.holds is False for verdict in verdicts) else 0


def _chosen(study: CaseStudy, sample: int | None, seed: int, what: str) -> Iterable[Combination]:
    if sample is None or sample >= study.size:
        return progress(study.combinations(), study.size, what)
    return progress(study.sample(sample, np.random.default_rng(seed)), sample, what)


def _show(verdicts: list[Verdict]) -> None:
    truth = {True: "yes", False: "NO", None: "-"}
    table(
        ("combination", "property", "value", "bounds", "holds"),
        [
            (
                verdict.combination,
                verdict.name,
                number(verdict.value),
                "-" if verdict.value is None else f"[{number(verdict.lower)}, {number(verdict.upper)}]",
                truth[verdict.holds],
            )
            for verdict in verdicts
        ],
    )
    false = [verdict for verdict in verdicts if verdict.holds is False]
    for verdict in false:
        say(f"{verdict.combination}: {verdict.name} ({verdict.property}) does not hold: {verdict.reason or 'see its value'}")
    combinations = len({verdict.combination for verdict in verdicts})
    say(f"{combinations} combinations, {len(verdicts)} verdicts, {len(false)} false")
