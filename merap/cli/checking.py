"""`check`: the properties of any PRISM model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from merap.checker.properties import TIMEOUT
from merap.cli import options
from merap.cli.output import number, require_free_report, say, table, warn, write_json
from merap.errors import EngineError

if TYPE_CHECKING:
    from merap.checker.checking import CheckedProperties, Result

FALSE = 1


def register(app: typer.Typer) -> None:
    """Add this verb."""
    app.command()(check)


def check(
    model: Annotated[
        Path, typer.Argument(help="PRISM text of a Markov chain or an MDP, or an archive .umb.")
    ],
    properties: Annotated[
        str, typer.Argument(metavar="PROPS", help="A file of properties, or one as 'Pmax=? [F \"goal\"]'.")
    ],
    constants: Annotated[
        list[str] | None,
        typer.Option("--const", metavar="NAME=VALUES", help="As n=3, n=1:10, p=0:0.1:1 or a=1,b=2."),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--property", help="Check this one only, by name or number.")
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="Limit for a model and for each property.")
    ] = TIMEOUT,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw values over a constant: PNG or SVG.")
    ] = None,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Check properties of any PRISM model, for every combination of values of its constants.

    Exits with 1 if a property is false, else with 3 if one has no answer.
    """
    from merap.checker.checking import check as check_properties

    require_free_report(json, force=force)
    require_free_report(plot, force=force)
    done = check_properties(model, properties, constants=constants or (), only=only or (), timeout=timeout)
    if plot is not None:
        _draw(done, model, plot, force=force)
    warn(done.notes)
    report = [result.as_dict() for result in done.results]
    write_json(json, {"model": str(model), "notes": done.notes, "results": report}, force=force)
    if str(json) != "-":
        _show(done)
    if any(result.holds is False for result in done.results):
        raise typer.Exit(FALSE)
    if any(result.status != "ok" for result in done.results):
        raise typer.Exit(EngineError.exit_code)


def _draw(done: CheckedProperties, model: Path, plot: Path, *, force: bool) -> None:
    from merap.checker.experiment import lines
    from merap.report.experiment import draw_experiment
    from merap.report.saving import save_figure

    constant, found = lines(done.results)
    save_figure(draw_experiment(found, constant, model.name), plot, force=force)


def _show(done: CheckedProperties) -> None:
    """Show a row for each property, or for each choice of constants; then why answers are missing."""
    from merap.checker.experiment import tables

    for found in tables(done.results):
        rows = [(*values, *map(_cell, row.values())) for values, row in found.rows.items()]
        if found.constants:
            names = list(next(iter(found.rows.values())))
            table((*found.constants, *names), rows)
            continue
        (row,) = found.rows.values()
        table(
            ("property", "value", "precision", "method", "seconds"),
            [(name, _cell(one), *_details(one)) for name, one in row.items()],
        )
    for line in dict.fromkeys(f"{one.status}: {one.reason}" for one in done.results if one.status != "ok"):
        say(line)


def _cell(result: Result) -> str:
    if result.status != "ok":
        return result.status
    truth = "" if result.holds is None else str(result.holds).lower()
    if result.value is None:
        return truth
    return f"{truth} ({number(result.value, 10)})" if truth else number(result.value, 10)


def _details(result: Result) -> tuple[str, str, str]:
    return number(result.precision, 2), result.method or "-", f"{result.seconds:.3f}"
