"""`merap`: the root of the command line and its exit codes."""

from __future__ import annotations

import sys
import warnings

import typer

from merap.cli import adapting, inspection, knowledge, learning, loop, modelling, policies, serving, tools
from merap.cli.output import complain
from merap.errors import MerapError

app = typer.Typer(
    help="Meta-reinforcement-learning adaptive planning over checked Markov decision processes.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (inspection, modelling, learning, adapting, policies, loop, knowledge, serving, tools):
    group.register(app)


def main() -> None:
    """Run; exit 0 when fine, 1 on a false verdict, 2 on wrong input, 3 if an engine failed."""
    warnings.simplefilter("ignore")  # of libraries; merap raises or reports what matters
    try:
        app()
    except MerapError as error:
        complain(str(error))
        sys.exit(error.exit_code)
