"""`schema`, `doctor`: help to write cases and to set the machine up."""

from __future__ import annotations

import importlib.metadata
import platform
import shutil
from typing import Annotated

import typer

from merap.cli import options
from merap.cli.output import require_free_report, say, table, write_json
from merap.concerns.schema_program import case_schema
from merap.mapek.scenario_schema import scenario_schema

PACKAGES = ("merap", "stormpy", "torch", "numpy", "scipy", "jinja2", "networkx", "pydantic", "matplotlib")


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(schema)
    app.command()(doctor)


def schema(
    scenario: Annotated[bool, typer.Option("--scenario", help="Of the scenario file of `run`.")] = False,
    out: options.OptionalOut = None,
    force: options.Force = False,
) -> None:
    """Print the JSON Schema of the case file, or of the scenario file, for editors."""
    require_free_report(out, force=force)
    content = scenario_schema() if scenario else case_schema()
    write_json(out if out is not None else options.STANDARD_OUTPUT, content, force=force)


def doctor() -> None:
    """Show versions and engines; say how to get a missing one."""
    rows = [("Python", platform.python_version(), "")]
    rows += [(name, importlib.metadata.version(name), "") for name in PACKAGES]
    rows.append(("Storm", *_storm()))
    rows.append(("PRISM-games", *_prism_games()))
    table(("component", "version", "note"), rows)
    say("Everything merap needs is here.")


def _storm() -> tuple[str, str]:
    from merap.checker.storm import version

    return version(), "used through stormpy"


def _prism_games() -> tuple[str, str]:
    found = shutil.which("prism")
    if found is None:
        return (
            "not found",
            "optional second engine: prismmodelchecker.org/games, then put `prism` on the PATH",
        )
    return "found", found
