"""`knowledge`: list, show, export and replay what a loop has recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from merap.cli import options
from merap.cli.output import (
    number,
    require_free_folder,
    require_free_report,
    require_verb,
    say,
    table,
    write_json,
)
from merap.errors import MerapError

if TYPE_CHECKING:
    from merap.concerns.case_study import CaseStudy
    from merap.knowledge.base import KnowledgeBase
    from merap.knowledge.replay import DecisionDifference
    from merap.knowledge.rows import DecisionRow, ObservationRow, RunRow

Db: TypeAlias = Annotated[
    str,
    typer.Option(
        "--db",
        help="Folder of a run, a file, or a URL: sqlite:///FILE, postgresql://USER@HOST/DATABASE.",
        show_default=False,
    ),
]
RunNumber: TypeAlias = Annotated[
    int, typer.Argument(metavar="NUMBER", help="Of the run, as `list` shows it.", show_default=False)
]
MOMENT = "%Y-%m-%d %H:%M:%S"


def register(app: typer.Typer) -> None:
    """Add these verbs, as a group."""
    group = typer.Typer(
        help="List, show, export and replay what a loop has recorded.",
        invoke_without_command=True,
        callback=require_verb,
        rich_markup_mode=None,
    )
    group.command("list")(list_runs)
    group.command()(show)
    group.command()(export)
    group.command()(replay)
    app.add_typer(group, name="knowledge")


def list_runs(db: Db, json: options.Json = None, force: options.Force = False) -> None:
    """List the runs of a knowledge base."""
    from merap.knowledge.export import run_record

    require_free_report(json, force=force)
    with _opened(db) as knowledge:
        place = knowledge.place
        found = [(row, knowledge.counts(row.id)) for row in knowledge.runs()]
    write_json(json, [{**run_record(row), "entries": dict(counts)} for row, counts in found], force=force)
    if str(json) == "-":
        return
    if not found:
        say(f"{place}: no runs")
        return
    table(
        ("run", "name", "case", "started (UTC)", "finished (UTC)", "observations", "decisions"),
        [
            (
                str(row.id),
                row.name,
                row.case,
                f"{row.started:{MOMENT}}",
                _finished(row),
                str(counts["observation"]),
                str(counts["decision"]),
            )
            for row, counts in found
        ],
    )


def show(
    run: RunNumber,
    db: Db,
    last: Annotated[int, typer.Option(min=0, help="How many decisions and events to print.")] = 20,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Show a run: case, settings, decisions with reasons, policies, events."""
    from dataclasses import asdict

    from merap.knowledge.export import decision_record, event_record, run_record

    require_free_report(json, force=force)
    with _opened(db) as knowledge:
        row, counts = knowledge.run(run), knowledge.counts(run)
        report = {
            **run_record(row),
            "entries": dict(counts),
            "models": [asdict(model) for model in knowledge.models(run)],
            "policies": [asdict(policy) for policy in knowledge.policies(run)],
            "decisions": [decision_record(decision) for decision in knowledge.decisions(run)],
            "events": [event_record(event) for event in knowledge.events(run)],
        }
    write_json(json, report, force=force)
    if str(json) != "-":
        _show(row, report, last)


def _show(row: RunRow, report: dict[str, Any], last: int) -> None:
    say(f"run {row.id}: {row.name}, case {row.case} ({row.digest[:12]})")
    say(f"started {row.started:{MOMENT}} UTC, finished {_finished(row)}")
    say(indent(_yaml(row.settings), "  "))
    entries = ", ".join(f"{count} {name}" for name, count in report["entries"].items() if count)
    say(f"entries: {entries or 'none'}")
    policies = report["policies"]
    if policies:
        kinds = Counter(policy["kind"] for policy in policies)
        say("policies: " + ", ".join(f"{count} {kind}" for kind, count in kinds.items()))
    told = [decision for decision in report["decisions"] if decision["reasons"]]
    decisions = told[-last:] if last else []
    if decisions:
        _heading("decisions with reasons", len(decisions), len(told))
        table(
            ("episode", "step", "decision", "reasons"),
            [(str(d["episode"]), str(d["step"]), d["kind"], "; ".join(d["reasons"])) for d in decisions],
        )
    events = report["events"][-last:] if last else []
    if events:
        _heading("events", len(events), len(report["events"]))
        table(
            ("time (UTC)", "component", "level", "message"),
            [(e["time"][:23], e["component"], e["level"], e["message"]) for e in events],
        )


def _yaml(content: Mapping[str, Any]) -> str:
    from ruamel.yaml import YAML

    stream = StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style, yaml.sort_base_mapping_type_on_output = False, False  # type: ignore[assignment]
    yaml.dump(content, stream)
    return stream.getvalue().rstrip()


def _heading(what: str, shown: int, there: int) -> None:
    say(f"\n{what}" if shown == there else f"\nthe last {shown} of {there} {what}")


def export(run: RunNumber, db: Db, out: options.Out, force: options.Force = False) -> None:
    """Write a run as a folder of CSV, JSON lines, UMB and safetensors, with a manifest."""
    from merap.families.folder import MANIFEST
    from merap.knowledge.export import export_run

    require_free_folder(out, (MANIFEST,), force=force)
    with _opened(db) as knowledge:
        files = export_run(knowledge, run, out)
    say(f"wrote {len(files)} files and a manifest to {out}")


def replay(
    run: RunNumber,
    db: Db,
    check: Annotated[
        Path | None,
        typer.Option(
            "--check", metavar="RUN", help="Folder of the training run: decide once more, and compare."
        ),
    ] = None,
    json: options.Json = None,
    force: options.Force = False,
) -> None:
    """Show observations and decisions in order; exit 1 if it would not be decided so again."""
    from dataclasses import asdict

    from merap.knowledge.export import decision_record, observation_record
    from merap.knowledge.replay import timeline
    from merap.knowledge.rows import ObservationRow

    require_free_report(json, force=force)
    with _opened(db) as knowledge:
        rows = list(timeline(knowledge, run))
        case = _case(db if check is None else str(check), knowledge.run(run).digest)
        found = () if check is None else _differences(check, knowledge, run)
    records = [
        {"observation": observation_record(row)}
        if isinstance(row, ObservationRow)
        else {"decision": decision_record(row)}
        for row in rows
    ]
    report = {
        "run": run,
        "timeline": records,
        "checked": check is not None,
        "differences": [asdict(difference) for difference in found],
    }
    write_json(json, report, force=force)
    if str(json) != "-":
        table(("episode", "step", "what", "reward", "detail"), [_timeline_row(row, case) for row in rows])
        if check is not None:
            say("\n".join(map(str, found)) or "the same is done and decided again")
    if found:
        raise typer.Exit(1)


def _differences(folder: Path, knowledge: KnowledgeBase, run: int) -> tuple[DecisionDifference, ...]:
    from merap.mapek.replaying import check_decisions
    from merap.runs.run_folder import read_run

    return check_decisions(read_run(folder), knowledge, run)


def _case(place: str, digest: str) -> CaseStudy | None:
    """Return the case of a recorded run, which has the names, if its run folder is there."""
    from merap.runs.run_folder import read_run

    path = Path(place.removeprefix("sqlite:///"))
    folder = path if path.is_dir() else path.parent
    try:
        case = read_run(folder).case
    except MerapError:
        return None
    return case if case.digest == digest else None


def _timeline_row(
    row: ObservationRow | DecisionRow, case: CaseStudy | None
) -> tuple[str, str, str, str, str]:
    from merap.knowledge.rows import DecisionRow

    place = (str(row.episode), str(row.step))
    if isinstance(row, DecisionRow):
        return (*place, f"decision: {row.kind}", "", "; ".join(row.reasons))
    named = f"action {row.action}" if case is None or row.action is None else case.actions[row.action]
    what = "reset" if row.action is None else named
    ending = " (done)" if row.continuation == 0 else " (truncated)" if row.truncated else ""
    seen = "nothing seen" if row.valuation is None else _state(row.valuation, case)
    return (*place, what, number(row.reward), seen + ending)


def _state(valuation: Sequence[int], case: CaseStudy | None) -> str:
    """Show the values of variables that have several, by name where the names are known."""
    from merap.systems.description import in_words, shown_variables

    if case is None:
        return " ".join(map(str, valuation))
    variables = shown_variables(case.combination_at(0).program)
    return " ".join(
        f"{one.name}={in_words(one, value)}"
        for one, value in zip(variables, valuation, strict=True)
        if one.low < one.high
    )


def _finished(row: RunRow) -> str:
    return "-" if row.finished is None else f"{row.finished:{MOMENT}}"


def _opened(db: str) -> KnowledgeBase:
    from merap.knowledge.base import open_knowledge
    from merap.knowledge.engine import url_of

    return open_knowledge(url_of(db), create=False)
