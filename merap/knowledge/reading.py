"""Read rows of the tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sqlalchemy import Connection, RowMapping, Select, func, select

from merap.errors import InputError
from merap.knowledge.rows import (
    CheckpointRow,
    DecisionRow,
    Entry,
    EventRow,
    ModelRow,
    ObservationRow,
    PolicyRow,
    ReportRow,
    Row,
    RunRow,
)
from merap.knowledge.tables import (
    HISTORY,
    CheckpointRecord,
    DecisionRecord,
    EventRecord,
    History,
    ModelRecord,
    ObservationRecord,
    PolicyRecord,
    ReportRecord,
    RunRecord,
)

PAGE = 1000


def _observation(row: RowMapping) -> ObservationRow:
    return ObservationRow(
        episode=row["episode"],
        step=row["step"],
        valuation=None if row["valuation"] is None else tuple(row["valuation"]),
        action=row["action"],
        reward=row["reward"],
        continuation=row["continuation"],
        truncated=row["truncated"],
        detections=row["detections"],
        enabled=None if row["enabled"] is None else tuple(row["enabled"]),
    )


def _decision(row: RowMapping) -> DecisionRow:
    return DecisionRow(row["episode"], row["step"], row["kind"], tuple(row["reasons"]), row["data"])


def _event(row: RowMapping) -> EventRow:
    return EventRow(row["time"], row["component"], row["level"], row["message"], row["data"])


def _model(row: RowMapping) -> ModelRow:
    return ModelRow(row["id"], row["name"], row["digest"])


def _policy(row: RowMapping) -> PolicyRow:
    return PolicyRow(row["id"], row["kind"], row["step"], row["digest"], row["model_id"])


def _checkpoint(row: RowMapping) -> CheckpointRow:
    return CheckpointRow(row["episode"], row["digest"])


def _report(row: RowMapping) -> ReportRow:
    return ReportRow(row["report"])


READERS: Mapping[type[History], Callable[[RowMapping], Row]] = {
    ObservationRecord: _observation,
    DecisionRecord: _decision,
    EventRecord: _event,
    ModelRecord: _model,
    PolicyRecord: _policy,
    CheckpointRecord: _checkpoint,
    ReportRecord: _report,
}


def read_page(connection: Connection, table: type[History], run: int, after: int) -> list[Entry]:
    """Return the next entries of a kind, at most PAGE, in order.

    Args:
        connection: to read by.
        table: the kind.
        run: its number.
        after: the position of the last one that is known.
    """
    query = (
        select(table.__table__)
        .where(table.run_id == run, table.position > after)
        .order_by(table.position)
        .limit(PAGE)
    )
    read = READERS[table]
    return [
        Entry(row["position"], row["recorded"], read(row)) for row in connection.execute(query).mappings()
    ]


def count(connection: Connection, table: type[History], run: int) -> int:
    """Count the entries of a kind that a run has."""
    number = connection.scalar(select(func.count()).select_from(table).where(table.run_id == run))
    return int(number or 0)


def last_position(connection: Connection, run: int, place: str) -> int:
    """Return the position of the last entry of a run's history; 0 if there is none.

    Raises:
        InputError: there is no such run.
    """
    beginnings = select(RunRecord.id - RunRecord.id).where(RunRecord.id == run)
    ends = [select(func.max(table.position)).where(table.run_id == run) for table in HISTORY]
    found = [*connection.scalars(beginnings.union_all(*ends))]
    positions = [int(position) for position in found if position is not None]
    if not positions:
        raise InputError(f"there is no run {run}", source=place)
    return max(positions)


def read_runs(connection: Connection, run: int | None = None) -> tuple[RunRow, ...]:
    """Return all runs, or one."""
    query: Select[Any] = select(RunRecord.__table__).order_by(RunRecord.id)
    if run is not None:
        query = query.where(RunRecord.id == run)
    return tuple(
        RunRow(**row, **_ending(connection, row["id"])) for row in connection.execute(query).mappings().all()
    )


def _ending(connection: Connection, run: int) -> Mapping[str, Any]:
    query = (
        select(ReportRecord.recorded, ReportRecord.report)
        .where(ReportRecord.run_id == run)
        .order_by(ReportRecord.position.desc())
        .limit(1)
    )
    found = connection.execute(query).one_or_none()
    return {"finished": found and found.recorded, "report": found and found.report}
