"""Migrate an older schema, refuse a newer one."""

from __future__ import annotations

import hashlib

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

from merap.errors import InputError
from merap.knowledge.engine import APPLICATION, SCHEMA_NAME
from merap.knowledge.tables import SCHEMA

SCRIPTS = "merap.knowledge:migrations"
_ADVISORY = int.from_bytes(hashlib.sha256(b"merap schema").digest()[:8], "big", signed=True)


def current_schema(connection: Connection) -> str | None:
    """Return the schema of the tables that are there; None if there are none."""
    return MigrationContext.configure(connection).get_current_revision()


def migrate(connection: Connection, place: str, target: str = SCHEMA) -> None:
    """Bring the tables to a schema, inside the transaction of a connection.

    Args:
        connection: in a transaction that holds SQLite's write lock.
        place: place of the knowledge base, for errors.
        target: the schema.

    Raises:
        InputError: the schema is newer than this version of merap.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY})
    found = current_schema(connection)
    config = Config()
    config.set_main_option("script_location", SCRIPTS)
    known = {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}
    if found is not None and found not in known:
        raise InputError(
            f"has schema {found}, this version of merap knows {min(known)} to {SCHEMA}; use a newer merap",
            source=place,
        )
    _mark(connection)
    config.attributes["connection"] = connection
    command.upgrade(config, target)


def _mark(connection: Connection) -> None:
    if connection.dialect.name == "sqlite":
        connection.execute(text(f"PRAGMA application_id = {APPLICATION}"))
    else:
        connection.execute(text(f"CREATE SCHEMA IF NOT EXISTS {SCHEMA_NAME}"))
