"""Runs and their history."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_IDENTITY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "run",
        sa.Column("id", _IDENTITY, primary_key=True),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("case", sa.Text(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("settings", sa.JSON(), nullable=False),
        sa.Column("started", _TIME, nullable=False),
    )
    op.create_table(
        "blob",
        sa.Column("digest", sa.String(64), primary_key=True),
        sa.Column("content", sa.LargeBinary(), nullable=False),
    )
    _history("model", sa.Column("name", sa.Text(), nullable=False), _blob())
    _history(
        "policy",
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("step", sa.Integer(), nullable=False),
        _blob(),
        sa.Column("model_id", _IDENTITY, sa.ForeignKey("model.id"), nullable=True),
    )
    _history(
        "observation",
        sa.Column("episode", sa.Integer(), nullable=False),
        sa.Column("step", sa.Integer(), nullable=False),
        sa.Column("valuation", sa.JSON(), nullable=True),
        sa.Column("action", sa.Integer(), nullable=True),
        sa.Column("reward", sa.Double(), nullable=False),
        sa.Column("continuation", sa.Double(), nullable=False),
        sa.Column("truncated", sa.Boolean(), nullable=False),
        sa.Column("detections", sa.JSON(), nullable=False),
        sa.Column("enabled", sa.JSON(), nullable=True),
    )
    _history(
        "decision",
        sa.Column("episode", sa.Integer(), nullable=False),
        sa.Column("step", sa.Integer(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("reasons", sa.JSON(), nullable=False),
        sa.Column("data", sa.JSON(), nullable=False),
    )
    _history(
        "event",
        sa.Column("time", _TIME, nullable=False),
        sa.Column("component", sa.Text(), nullable=False),
        sa.Column("level", sa.Text(), nullable=False),
        sa.Column("message", sa.Text(), nullable=False),
        sa.Column("data", sa.JSON(), nullable=False),
    )
    _history("checkpoint", sa.Column("episode", sa.Integer(), nullable=False), _blob())
    _history("report", sa.Column("report", sa.JSON(), nullable=False))


def _history(name: str, *columns: sa.Column[object]) -> None:
    op.create_table(
        name,
        sa.Column("id", _IDENTITY, primary_key=True),
        sa.Column("run_id", _IDENTITY, sa.ForeignKey("run.id"), nullable=False),
        sa.Column("position", sa.BigInteger(), nullable=False),
        sa.Column("recorded", _TIME, nullable=False),
        *columns,
    )
    op.create_index(f"{name}_position", name, ["run_id", "position"], unique=True)


def _blob() -> sa.Column[object]:
    return sa.Column("digest", sa.String(64), sa.ForeignKey("blob.digest"), nullable=False)
