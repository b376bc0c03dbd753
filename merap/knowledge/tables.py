"""Describe the tables. Rows are only ever inserted; `migrations` makes the tables and guards them."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    String,
    Text,
    TypeDecorator,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, declared_attr, mapped_column

# of the newest migration
SCHEMA = "0003"
# of the constraint; a database that refuses a row for it says so
CHECKPOINT_EPISODE = "checkpoint_episode"
# SQLite numbers rows itself only where the column is an INTEGER
Identity = BigInteger().with_variant(Integer, "sqlite")


class UtcTime(TypeDecorator[datetime]):
    """An aware time; SQLite stores no zone, PostgreSQL answers in that of the session."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the time in UTC."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the time in UTC."""
        if value is None or value.tzinfo is not None:
            return None if value is None else value.astimezone(UTC)
        return value.replace(tzinfo=UTC)


class PlainText(TypeDecorator[str]):
    """Text of any origin; PostgreSQL stores no NUL, and neither stores half a character."""

    impl = Text()
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Put a mark in place of each character that can't be stored."""
        if value is None:
            return None
        return value.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")


class StrictJson(TypeDecorator[Any]):
    """JSON without NaN and infinities; numbers and arrays of numpy become plain ones."""

    impl = JSON(none_as_null=True)
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> Any:
        """Return plain values.

        Raises:
            ValueError: it has no such form.
            TypeError: likewise.
        """
        return json.loads(json.dumps(value, allow_nan=False, default=_plain))


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} has no JSON form")


class Base(DeclarativeBase):
    """All tables."""

    type_annotation_map = {datetime: UtcTime(), str: PlainText(), float: Double()}  # noqa: RUF012 - read by SQLAlchemy


class RunRecord(Base):
    """Runs of the loop."""

    __tablename__ = "run"

    id: Mapped[int] = mapped_column(Identity, primary_key=True)
    name: Mapped[str]
    case: Mapped[str]
    digest: Mapped[str]
    settings: Mapped[Any] = mapped_column(StrictJson(), nullable=False)
    started: Mapped[datetime]


class BlobRecord(Base):
    """Bytes by their SHA-256, stored once."""

    __tablename__ = "blob"

    digest: Mapped[str] = mapped_column(String(64), primary_key=True)
    content: Mapped[bytes] = mapped_column(LargeBinary)


class History(Base):
    """The columns that every entry in the history of a run has."""

    __abstract__ = True

    id: Mapped[int] = mapped_column(Identity, primary_key=True)
    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"))
    position: Mapped[int] = mapped_column(BigInteger)
    recorded: Mapped[datetime]

    @declared_attr.directive
    def __table_args__(cls) -> tuple[Index, ...]:  # noqa: N805 - of the class
        return (Index(f"{cls.__tablename__}_position", "run_id", "position", unique=True),)


class ModelRecord(History):
    """Models, as UMB archives."""

    __tablename__ = "model"

    name: Mapped[str]
    digest: Mapped[str] = mapped_column(ForeignKey("blob.digest"))


class PolicyRecord(History):
    """Policies, as safetensors."""

    __tablename__ = "policy"

    kind: Mapped[str]
    step: Mapped[int]
    digest: Mapped[str] = mapped_column(ForeignKey("blob.digest"))
    model_id: Mapped[int | None] = mapped_column(ForeignKey("model.id"))


class ObservationRecord(History):
    """Observations of a system, each with the action that led to it."""

    __tablename__ = "observation"

    episode: Mapped[int]
    step: Mapped[int]
    valuation: Mapped[Any] = mapped_column(StrictJson(), nullable=True)
    action: Mapped[int | None]
    reward: Mapped[float]
    continuation: Mapped[float]
    truncated: Mapped[bool]
    detections: Mapped[Any] = mapped_column(StrictJson(), nullable=False)
    enabled: Mapped[Any] = mapped_column(StrictJson(), nullable=True)


class DecisionRecord(History):
    """Decisions with their reasons."""

    __tablename__ = "decision"

    episode: Mapped[int]
    step: Mapped[int]
    kind: Mapped[str]
    reasons: Mapped[Any] = mapped_column(StrictJson(), nullable=False)
    data: Mapped[Any] = mapped_column(StrictJson(), nullable=False)


class EventRecord(History):
    """Lines of the log."""

    __tablename__ = "event"

    time: Mapped[datetime]
    component: Mapped[str]
    level: Mapped[str]
    message: Mapped[str]
    data: Mapped[Any] = mapped_column(StrictJson(), nullable=False)


class CheckpointRecord(History):
    """States to go on from, one for each episode of a run."""

    __tablename__ = "checkpoint"

    @declared_attr.directive
    def __table_args__(cls) -> tuple[Index, ...]:  # noqa: N805 - of the class
        return *super().__table_args__, Index(CHECKPOINT_EPISODE, "run_id", "episode", unique=True)

    episode: Mapped[int]
    digest: Mapped[str] = mapped_column(ForeignKey("blob.digest"))


class ReportRecord(History):
    """Reports of how a run ended; of several the last one holds."""

    __tablename__ = "report"

    report: Mapped[Any] = mapped_column(StrictJson(), nullable=False)


HISTORY: tuple[type[History], ...] = (
    ModelRecord,
    PolicyRecord,
    ObservationRecord,
    DecisionRecord,
    EventRecord,
    CheckpointRecord,
    ReportRecord,
)
