"""`validate`, `show`, `difference`: look at a case."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from merap.cli import options
from merap.cli.describing import say_case, say_decisions, say_system, summary
from merap.cli.output import job, number, require_free_report, say, table, warn, write_json
from merap.concerns.warnings import numbers_without_domain
from merap.errors import InputError
from merap.families.loading import load_case

Weight = Annotated[float, typer.Option(min=0, max=1e9)]


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(validate)
    app.command()(show)
    app.command()(difference)


def validate(case: options.Case) -> None:
    """Check that a case is sound; say what it consists of."""
    study = load_case(case)
    warn(study.warnings)
    say(summary(study))
    for note in numbers_without_domain(study.read_system.context.parameters):
        say(f"note: {note}")


class Optimum(StrEnum):
    """What is told of an optimal policy: its first decisions, or its likeliest path."""

    none = "none"
    policy = "policy"
    path = "path"


def show(
    case: options.Case,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Picture to write: PNG or SVG; both without a suffix."),
    ] = None,
    system: options.SystemName = None,
    attribute: Annotated[str | None, typer.Option(help="Which attribute to colour the locations by.")] = None,
    optimum: Annotated[
        Optimum,
        typer.Option(help="Tell and draw an optimal policy as it begins, or its likeliest path."),
    ] = Optimum.none,
    force: options.Force = False,
) -> None:
    """Say what a case consists of; draw a system: its map, if it has one, and its processes."""
    from merap.families.models import explored
    from merap.mdp.evaluation import as_policy
    from merap.mdp.planning import backward_induction
    from merap.report.decisions import decisions
    from merap.report.map import draw_combination
    from merap.report.path import most_likely_path
    from merap.report.saving import save_figure

    study = load_case(case)
    warn(study.warnings)
    shown = options.chosen_system(study, system)
    if attribute is not None and out is None:
        raise InputError("colours a picture; say by --out where to write it", source="--attribute")
    model, horizon = explored(shown), shown.objective.horizon
    policy, paths, told = None, [], None
    if optimum is not Optimum.none:
        plan = backward_induction(model, horizon, shown.discount)
        best = as_policy(model, plan.actions)
        if optimum is Optimum.path:
            paths = [most_likely_path(model, shown, best, horizon, label="optimal path")]
        else:
            policy, told = best[0], decisions(shown.program, model, plan.actions[0])
    written: tuple[Path, ...] = ()
    if out is not None:
        title = f"{study.name}: {shown.name}"
        figure = draw_combination(shown, attribute=attribute, policy=policy, paths=paths, title=title)
        written = save_figure(figure, out, force=force)
    say_case(study)
    say_system(shown, model)
    if optimum is not Optimum.none:
        say(f"optimum {number(plan.value)}")
    for path in paths:
        say(path.text)
    if told is not None:
        say_decisions(told)
    for file in written:
        say(f"wrote {file}")


def difference(
    case: options.Case,
    system: options.SystemName = None,
    w1: Weight = 1.0,
    w2: Weight = 1.0,
    most: Annotated[int, typer.Option(min=1, help="How many of the nearest combinations to list.")] = 5,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Show how far a system is from the model base (the paper's eq:diff), and the nearest combination."""
    from merap.families.build import MAX_TASKS, build_base
    from merap.families.models import explored
    from merap.mdp.difference import differences

    require_free_report(json, force=force)
    study = load_case(case)
    combination = options.chosen_system(study, system)
    with job("Building models", min(study.size, MAX_TASKS)) as bar:
        base = build_base(study, on_model=bar.advance)
    whole = explored(combination)
    base = base.extended(whole)
    found = differences(
        base.index.place(whole),
        dict(zip(base.names, base.models, strict=True)),
        w1,
        w2,
    )
    ranked = sorted(found.items(), key=lambda item: item[1].total)
    name, least = ranked[0]
    report = {
        "case": study.name,
        "system": combination.name,
        "w1": w1,
        "w2": w2,
        "combinations": base.covered,
        "compared": len(ranked),
        "difference": least.total,
        "nearest": name,
        "terms": [{"combination": name, **asdict(terms)} for name, terms in ranked],
    }
    write_json(json, report, force=force)
    if str(json) == "-":
        return
    table(
        ("combination", "difference", "transitions", "rewards"),
        [
            (name, number(terms.total), number(terms.transition), number(terms.reward))
            for name, terms in ranked[:most]
        ],
    )
    drawn = "" if len(ranked) == base.covered else f" (of {len(ranked)} drawn from {base.covered})"
    say(f"{combination.name} differs from the base by {number(least.total)}; nearest{drawn}: {name}")
