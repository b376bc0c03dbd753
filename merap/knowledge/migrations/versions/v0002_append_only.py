"""The history is append-only, whoever writes: no row is changed, removed or replaced."""

from __future__ import annotations

from alembic import op

revision = "0002"
down_revision = "0001"

_HISTORY = ("model", "policy", "observation", "decision", "event", "checkpoint", "report")
_REFUSED = "the knowledge base is append-only: record a correction as a new row"


def upgrade() -> None:
    """Guard the tables."""
    if op.get_bind().dialect.name == "sqlite":
        _guard_sqlite()
    else:
        _guard_postgresql()


def _guard_sqlite() -> None:
    for table in ("run", "blob", *_HISTORY):
        for verb in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {table}_no_{verb.lower()} BEFORE {verb} ON {table} "
                f"BEGIN SELECT RAISE(ABORT, '{_REFUSED}'); END"
            )
    # INSERT OR REPLACE removes rows without their DELETE trigger
    _guard_replacing("run", "id = NEW.id")
    _guard_replacing("blob", "digest = NEW.digest AND content IS NOT NEW.content")
    for table in _HISTORY:
        _guard_replacing(table, "id = NEW.id")
        _guard_replacing(table, "run_id = NEW.run_id AND position = NEW.position", "place")


def _guard_replacing(table: str, same: str, what: str = "row") -> None:
    op.execute(
        f"CREATE TRIGGER {table}_no_replace_{what} BEFORE INSERT ON {table} "
        f"WHEN EXISTS (SELECT 1 FROM {table} WHERE {same}) "
        f"BEGIN SELECT RAISE(ABORT, '{_REFUSED}'); END"
    )


def _guard_postgresql() -> None:
    op.execute(
        "CREATE FUNCTION append_only() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{_REFUSED}' USING ERRCODE = 'restrict_violation'; END $$"
    )
    for table in ("run", "blob", *_HISTORY):
        op.execute(
            f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {table} "
            "FOR EACH STATEMENT EXECUTE FUNCTION append_only()"
        )
