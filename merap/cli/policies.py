"""`export-policy`: write a learned policy for use elsewhere."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from merap.cli import options
from merap.cli.output import counted, job, require_free_report, say
from merap.errors import InputError

if TYPE_CHECKING:
    from merap.concerns.combination import Combination
    from merap.families.build import ModelBase
    from merap.learning.meta import MetaPolicy
    from merap.runs.run_folder import RunFolder


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(export_policy)


class PolicyFormat(StrEnum):
    """A file format of policies."""

    csv = "csv"
    npz = "npz"
    prism = "prism"


def export_policy(
    run: Annotated[Path, typer.Argument(help="Folder of a training run.", show_default=False)],
    out: options.Out,
    kind: Annotated[
        PolicyFormat,
        typer.Option("--format", help="csv, npz: a table; prism: a system under the policy, to be checked."),
    ] = PolicyFormat.csv,
    system: Annotated[
        str | None,
        typer.Option(help="An online system or a combination; a table without one is for the whole base."),
    ] = None,
    adapt_steps: Annotated[int, typer.Option(min=0, help="Gradient steps on the system before.")] = 0,
    episodes_per_step: Annotated[int, typer.Option(min=1, help="Real episodes of a gradient step.")] = 35,
    seed: options.Seed = 0,
    force: options.Force = False,
) -> None:
    """Write the meta policy, or one adapted to a system, for use without merap."""
    from merap.families.folder import write_bytes
    from merap.runs.run_folder import read_run

    require_free_report(out, force=force)
    opened = read_run(run)
    if system is None and (adapt_steps or kind is PolicyFormat.prism):
        option = "--adapt-steps" if adapt_steps else "--format prism"
        known = ", ".join(opened.case.systems) or "none, so name a combination"
        raise InputError(f"{option} needs a system; those of the case: {known}", source="--system")
    combination = None if system is None else opened.case.system(system)
    meta, base = _policy(opened, combination, adapt_steps, episodes_per_step, seed)
    title = (
        f"{opened.case.name}: the meta policy"
        if combination is None
        else f"{opened.case.name} on {combination.name}: "
    )
    if combination is not None:
        steps = (
            f"{counted(adapt_steps, 'gradient step')} of {counted(episodes_per_step, 'episode')}, seed {seed}"
        )
        title += steps if adapt_steps else "the meta policy"
    write_bytes(out, _content(kind, opened, base, combination, meta, title), force=force)
    say(f"{title}; wrote {out}")


def _policy(
    run: RunFolder, combination: Combination | None, adapt_steps: int, episodes_per_step: int, seed: int
) -> tuple[MetaPolicy, ModelBase]:
    if combination is None or not adapt_steps:
        from merap.runs.checkpoint import read_policy
        from merap.runs.run_folder import read_base
        from merap.runs.train import batch_of

        base = read_base(run)
        return read_policy(run, batch_of(base)), base
    from merap.strategies.adapted_policy import adapted_policy

    with job("Adapting", adapt_steps) as bar:
        return adapted_policy(
            run,
            combination,
            steps=adapt_steps,
            episodes_per_step=episodes_per_step,
            seed=seed,
            on_step=bar.advance,
        )


def _content(
    kind: PolicyFormat,
    run: RunFolder,
    base: ModelBase,
    combination: Combination | None,
    meta: MetaPolicy,
    title: str,
) -> bytes:
    from merap.runs import policy_export

    if combination is not None and kind is PolicyFormat.prism:
        return policy_export.prism_text(meta, base, combination, title).encode()
    table = policy_export.tabulate_on(meta, base, combination)
    if kind is PolicyFormat.npz:
        return policy_export.npz_bytes(table, run.case, title)
    return policy_export.csv_text(table, run.case).encode()
