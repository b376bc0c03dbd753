"""Every verb of the command line, and one clear line for wrong usage."""

from __future__ import annotations

import sys
import warnings
from importlib.metadata import version
from typing import Annotated

import typer
from pydantic import ValidationError

from merap.cli import (
    adapting,
    checking,
    inspection,
    knowledge,
    learning,
    loop,
    modelling,
    policies,
    serving,
    tools,
)
from merap.cli.interruption import INTERRUPTED, interrupted_line
from merap.cli.output import require_verb, say
from merap.concerns.validation import message
from merap.errors import InputError

app = typer.Typer(
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (inspection, modelling, checking, learning, adapting, policies, loop, knowledge, serving, tools):
    group.register(app)


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    show_version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Meta-reinforcement-learning adaptive planning over checked Markov decision processes."""
    if show_version:
        say(f"merap {version('merap')}")
    else:
        require_verb(context)


def run() -> int:
    """Run the verb that the process was called with; return its exit code.

    Raises:
        MerapError: something the user can mend.
    """
    warnings.simplefilter("ignore")  # of libraries; merap raises or reports what matters
    try:
        code = app(prog_name="merap", standalone_mode=False)
    except typer.TyperException as error:
        raise _wrong_usage(error) from error
    except typer.Abort:
        code = INTERRUPTED
    if code == INTERRUPTED:  # raised by Python, not by a signal
        sys.stderr.write(f"{interrupted_line()}\n")
    return code or 0


def _wrong_usage(error: typer.TyperException) -> InputError:
    """Return wrong words on the command line as one clear line."""
    context = getattr(error, "ctx", None)
    verb = "merap" if context is None else context.command_path
    cause = error.__cause__
    if isinstance(error, typer.BadParameter) and isinstance(cause, ValidationError):
        details = cause.errors(include_url=False)[0]
        told = details.get("ctx", {}).get("error")  # names the value and what is allowed
        source = verb if error.param is None else " or ".join(error.param.opts)
        return InputError(message(details) if told is None else str(told).rstrip("."), source=source)
    return InputError(f"{error.format_message().rstrip('.')}; see {verb} --help", source=verb)
