"""`run`: the MAPE-K loop on a scenario."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from merap.cli import options
from merap.cli.interruption import go_on_with
from merap.cli.output import (
    counted,
    job,
    number,
    progress_line,
    require_free_folder,
    require_free_report,
    say,
    table,
    warn,
    write_json,
)

if TYPE_CHECKING:
    from merap.mapek.records import EpisodeRow
    from merap.mapek.scores import LoopReport

PICTURE = "timeline"
REPORT = "report.json"
# Number of lines of progress where no terminal shows a bar.
LINES = 10


def register(app: typer.Typer) -> None:
    """Add these verbs."""
    app.command()(run)


def run(
    run_folder: Annotated[
        Path, typer.Argument(metavar="RUN", help="Folder of a training run.", show_default=False)
    ],
    scenario: Annotated[
        Path,
        typer.Option("--scenario", help="A scenario file: the system, and its changes.", show_default=False),
    ],
    db: Annotated[
        str | None, typer.Option("--db", help="Knowledge base, a URL or a file; RUN/knowledge.db by default.")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="File of JSON lines that the log goes to; RUN/events.jsonl by default."),
    ] = None,
    manager: Annotated[
        str, typer.Option(help="merap, or to compare with: none, random, static, reactive.")
    ] = "merap",
    resume: Annotated[
        bool, typer.Option(help="Go on with the last run of this scenario, from where it was killed.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the report and the timeline (PNG, SVG).")
    ] = None,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Control a system, simulated or real, that may change: monitor, analyse, plan, execute, learn."""
    from merap.knowledge.base import open_knowledge
    from merap.knowledge.engine import default_url, url_of
    from merap.knowledge.event_log import FILE_NAME, JsonLines
    from merap.mapek.family_limits import followable
    from merap.mapek.run import run_loop
    from merap.mapek.scenario import read_scenario
    from merap.runs.run_folder import read_run

    require_free_report(json, force=force)
    require_free_report(log, force=True)  # it may be there, and grows
    if out is not None:
        require_free_folder(out, (REPORT, f"{PICTURE}.png", f"{PICTURE}.svg"), force=force)
    read, opened = read_scenario(scenario), read_run(run_folder)
    read, notices = followable(read, opened.case)
    warn(notices)
    url = default_url(run_folder) if db is None else url_of(db)
    lines = JsonLines(run_folder / FILE_NAME if log is None else log)
    begun = Event()
    given = {"--db": db, "--log": log, "--manager": manager, "--out": out, "--json": json}
    words = [str(word) for option, value in given.items() if value is not None for word in (option, value)]
    again = ["merap", "run", str(run_folder), "--scenario", str(scenario), *words, "--resume"]
    go_on_with(shlex.join(again), when=begun.is_set)
    with (
        lines,
        open_knowledge(url, notice=lines.notice) as knowledge,
        job("Running", read.spec.episodes) as bar,
    ):

        def told(row: EpisodeRow) -> None:
            begun.set()
            done, of_all = row.episode + 1, read.spec.episodes
            bar.draw(done, f"{row.earned:.4g}")
            if str(json) != "-" and (done % max(1, of_all // LINES) == 0 or done == of_all):
                progress_line(
                    f"{done} of {counted(of_all, 'episode')}; the last returned {number(row.earned, 4)}"
                )

        report = run_loop(
            opened,
            read,
            manager=manager,
            knowledge=knowledge,
            lines=lines,
            resume=resume,
            on_episode=told,
        )
    write_json(json, report.as_dict(), force=force)
    if out is not None:
        _write(report, out, force=force)
    if str(json) != "-":
        _show(report)
    if report.ended_by is not None:
        raise report.ended_by


def _write(report: LoopReport, folder: Path, *, force: bool) -> None:
    from merap.report.saving import save_figure
    from merap.report.timeline import draw_timeline

    write_json(folder / REPORT, report.as_dict(), force=force)
    pictures = save_figure(draw_timeline(report), folder / PICTURE, force=force)
    say("wrote " + ", ".join(str(path) for path in (folder / REPORT, *pictures)))


def _show(report: LoopReport) -> None:
    """Show a row for each change, then the sums."""
    rows = [
        (
            str(reaction.episode),
            ", ".join(reaction.changed),
            _whole(reaction.replanned),
            _whole(reaction.episodes),
            _whole(reaction.steps),
            number(report.seconds_to_recover(reaction), 3),
            number(reaction.lost, 4),
        )
        for reaction in report.reactions
    ]
    columns = ("change at", "of", "re-planned at", "episodes", "steps", "seconds", "lost")
    if rows:
        table(columns, rows)
    found = report.as_dict()["summary"]
    say(
        f"{counted(found['episodes'], 'episode')} returned {number(found['mean_return'], 4)} on average"
        f"{_possible(found)}; {found['completed']} ended{_violations(found)}"
    )
    faults = ", ".join(f"{count} {kind}" for kind, count in found["faults"].items())
    told = f"; faults: {faults}" if faults else ""
    recovered = (
        f"; recovered from {found['changes_recovered_from']} of {counted(found['changes'], 'change')}"
        if found["mean_optimum"] is not None
        else ""
    )
    say(
        f"{counted(found['adaptations'], 're-planning')}, "
        f"{counted(found['policy_updates'], 'policy update')}, "
        f"{counted(found['fallbacks'], 'fallback')}{recovered}{told}"
    )


def _possible(found: Mapping[str, Any]) -> str:
    """Say how much could have been earned, if the ground truth is known."""
    if found["mean_optimum"] is None:
        return ""
    safe = found["mean_safe_optimum"]
    within = "" if safe is None else f", {number(safe, 4)} within the shield's threshold"
    return f", {number(found['mean_optimum'], 4)} was possible{within}"


def _violations(found: Mapping[str, Any]) -> str:
    """Say in how many episodes an unsafe state was reached, if that is known."""
    count = found["violations"]
    return "" if count is None else f", {counted(count, 'violation')}"


def _whole(value: int | None) -> str:
    return "-" if value is None else str(value)
