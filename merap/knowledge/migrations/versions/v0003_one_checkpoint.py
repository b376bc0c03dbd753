"""An episode of a run is kept once, so that two processes that go on with one run can't mix in it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

_NAME = "checkpoint_episode"
_REFUSED = "the knowledge base is append-only: this episode of the run is there"


def upgrade() -> None:
    """Make checkpoints of a run and an episode unique, from here on."""
    connection = op.get_bind()
    newer = _newer(connection)
    op.execute(f"CREATE UNIQUE INDEX {_NAME} ON checkpoint (run_id, episode){newer}")
    if connection.dialect.name == "sqlite":
        # INSERT OR REPLACE removes rows without their DELETE trigger
        op.execute(
            "CREATE TRIGGER checkpoint_no_replace_episode BEFORE INSERT ON checkpoint "
            "WHEN EXISTS "
            "(SELECT 1 FROM checkpoint WHERE run_id = NEW.run_id AND episode = NEW.episode) "
            f"BEGIN SELECT RAISE(ABORT, '{_NAME}: {_REFUSED}'); END"
        )


def _newer(connection: sa.Connection) -> str:
    """The condition of the index: rows that break the rule are there for good, and stay outside it."""
    twice = "SELECT 1 FROM checkpoint GROUP BY run_id, episode HAVING count(*) > 1"
    if connection.scalar(sa.text(twice)) is None:
        return ""
    return f" WHERE id > {connection.scalar(sa.text('SELECT max(id) FROM checkpoint'))}"
