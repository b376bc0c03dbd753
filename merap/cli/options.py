"""Arguments and options that several verbs have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from merap.cli.output import warn
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination, ResetMode

MET = "met"

Case: TypeAlias = Annotated[
    Path, typer.Argument(help="A case file, or a folder that holds case.yaml.", show_default=False)
]
Out: TypeAlias = Annotated[Path, typer.Option("--out", "-o", help="Where to write.", show_default=False)]
Json: TypeAlias = Annotated[
    Path | None, typer.Option("--json", help="Also write the report as JSON; - is standard output.")
]
Force: TypeAlias = Annotated[bool, typer.Option("--force", help="Write over an existing file.")]
Sample: TypeAlias = Annotated[
    int | None, typer.Option("--sample", min=1, help="Take that many combinations at random, not all.")
]
Seed: TypeAlias = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
SystemName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--system",
        help="An online system of the case, or a combination; by default the system met, else the first.",
    ),
]
OptionalOut: TypeAlias = Annotated[
    Path | None, typer.Option("--out", "-o", help="Where to write; standard output by default.")
]
RewardNoise: TypeAlias = Annotated[
    float,
    typer.Option(
        "--reward-noise", min=0, metavar="SD", help="Standard deviation of Gaussian noise on rewards."
    ),
]
Slip: TypeAlias = Annotated[
    float,
    typer.Option("--slip", metavar="P", help="Probability that an action does nothing: in [0, 1)."),
]
Reset: TypeAlias = Annotated[
    ResetMode | None,
    typer.Option("--reset", help="How an episode begins, in place of what the case says."),
]

STANDARD_OUTPUT = Path("-")


def chosen_system(case: CaseStudy, name: str | None) -> Combination:
    """Return the system that `--system` names, else the system `met`, the first one, or a combination.

    Raises:
        InputError: there is no such system.
    """
    if name is not None or MET in case.systems:
        return case.system(name or MET)
    chosen = next(iter(case.systems.values()), None) or case.combination_at(0)
    warn([f"{case.name} has no online system {MET!r}; without --system this one is taken: {chosen.name}"])
    return chosen
