"""`serve`: a simulated system for another manager."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from merap.cli import options
from merap.cli.interruption import interruption_calls
from merap.cli.output import say, warn
from merap.errors import InputError
from merap.families.loading import load_case


def register(app: typer.Typer) -> None:
    """Add this verb."""
    app.command()(serve)


def serve(
    case: options.Case,
    system: options.SystemName = None,
    scenario: Annotated[
        Path | None, typer.Option(help="A scenario file: what is met changes as it says.")
    ] = None,
    port: Annotated[int, typer.Option(help="0 takes any that is free.")] = 3000,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    seed: options.Seed = 0,
    reward_noise: options.RewardNoise = 0.0,
    slip: options.Slip = 0.0,
    detect: Annotated[bool, typer.Option(help="Whether the case's detectors are read.")] = True,
    reset: options.Reset = None,
    deadline: Annotated[
        float | None, typer.Option(metavar="S", help="Seconds for a decision; needs --fallback.")
    ] = None,
    fallback: Annotated[
        str | None, typer.Option(help="What the system does when no decision comes in time.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell nothing of single requests.")] = False,
) -> None:
    """Offer a simulated system behind HTTP, with the endpoints of UPISAS.

    It goes on until it is interrupted, which is its ordinary end: the exit code is 0.
    """
    import numpy as np

    from merap.mapek.scenario import read_scenario
    from merap.mapek.serving import served_combination, served_scenario
    from merap.systems.http_server import listening, server
    from merap.systems.served import Pace

    if (deadline is None) != (fallback is None):
        raise InputError("--deadline and --fallback belong together", source="merap serve")
    pace = None if deadline is None or fallback is None else Pace(deadline, fallback)
    study = load_case(case)
    warn(study.warnings)
    if scenario is None:
        served = served_combination(
            options.chosen_system(study, system),
            np.random.default_rng(seed),
            slip=slip,
            noise=reward_noise,
            detect=detect,
            reset=reset,
            pace=pace,
        )
    else:
        if system is not None or slip or reward_noise or reset is not None or seed:
            raise InputError(
                "the scenario says what is met, with seed, noise, slip and reset; give none",
                source="--scenario",
            )
        served = served_scenario(study, read_scenario(scenario), detect=detect, pace=pace)
    with listening(host, port) as listener:
        if not quiet:
            _log_to_standard_error()
        address = f"http://{host}:{listener.getsockname()[1]}"
        offered = server(served)
        with interruption_calls(partial(setattr, offered, "should_exit", True)):
            say(f"{served.interface.system} of {study.name} on {address}; interrupt to end")
            offered.run(sockets=[listener])
        say("ended")


def _log_to_standard_error() -> None:
    """Log to standard error, one line for each message."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    logger = logging.getLogger("merap.systems")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
