"""`serve`: a simulated system for another manager."""

from __future__ import annotations

import logging
from typing import Annotated

import typer

from merap.cli import options
from merap.cli.output import say, warn
from merap.concerns.case_study import load_case
from merap.concerns.combination import ResetMode


def register(app: typer.Typer) -> None:
    """Add this verb."""
    app.command()(serve)


def serve(
    case: options.Case,
    system: options.SystemName = "met",
    port: Annotated[int, typer.Option(help="0 takes any that is free.")] = 3000,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    seed: options.Seed = 0,
    reward_noise: Annotated[
        float, typer.Option(min=0, metavar="SD", help="Deviation of Gaussian noise on rewards.")
    ] = 0.0,
    slip: Annotated[
        float, typer.Option(min=0, max=1, metavar="P", help="Probability that an action does nothing.")
    ] = 0.0,
    detect: Annotated[bool, typer.Option(help="Whether the case's detectors are read.")] = True,
    reset: Annotated[
        ResetMode | None, typer.Option(help="How an episode begins, in place of what the case says.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell nothing of single requests.")] = False,
) -> None:
    """Offer a simulated system behind HTTP, with the endpoints of UPISAS, until it is interrupted."""
    import numpy as np

    from merap.online.managed.http_server import listening, server
    from merap.online.managed.interface import interface_of
    from merap.online.managed.served import ServedSystem
    from merap.online.systems import SimulatedSystem

    study = load_case(case)
    warn(study.warnings)
    met = study.system(system)
    simulated = SimulatedSystem(
        met,
        met.objective.horizon,
        np.random.default_rng(seed),
        slip=slip,
        noise=reward_noise,
        detect=detect,
        reset=reset or met.reset,
    )
    served = ServedSystem(simulated, interface_of(met, detect=detect))
    with listening(host, port) as listener:
        if not quiet:
            _tell_requests()
        say(f"{met.name} of {study.name} on http://{host}:{listener.getsockname()[1]}; interrupt to end")
        try:
            server(served).run(sockets=[listener])
        except KeyboardInterrupt:
            say("ended")


def _tell_requests() -> None:
    """One line each on standard error."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    logger = logging.getLogger("merap.online.managed")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
