"""Arguments and options that several verbs have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from merap.concerns.combination import ResetMode

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
Seed: TypeAlias = Annotated[int, typer.Option("--seed", min=0, help="Of everything random.")]
SystemName: TypeAlias = Annotated[
    str, typer.Option("--system", help="An online system of the case, or a combination.")
]
OptionalOut: TypeAlias = Annotated[
    Path | None, typer.Option("--out", "-o", help="Where to write; standard output by default.")
]
RewardNoise: TypeAlias = Annotated[
    float,
    typer.Option("--reward-noise", min=0, metavar="SD", help="Deviation of Gaussian noise on rewards."),
]
Slip: TypeAlias = Annotated[
    float,
    typer.Option("--slip", min=0, max=1, metavar="P", help="Probability that an action does nothing."),
]
Reset: TypeAlias = Annotated[
    ResetMode | None,
    typer.Option("--reset", help="How an episode begins, in place of what the case says."),
]

STANDARD_OUTPUT = Path("-")
