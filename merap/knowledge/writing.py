"""Insert rows into the tables; nothing is ever changed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Connection, func, insert, select
from sqlalchemy.dialects import postgresql, sqlite

from merap.knowledge.reading import last_position
from merap.knowledge.rows import now
from merap.knowledge.tables import Base, BlobRecord, History


def insert_row(connection: Connection, table: type[Base], row: Mapping[str, Any]) -> int:
    """Insert a row, and return its number."""
    key = connection.execute(insert(table).values(**row)).inserted_primary_key
    assert key is not None
    return int(key[0])


def append(
    connection: Connection, table: type[History], run: int, rows: Sequence[Mapping[str, Any]], place: str
) -> list[int]:
    """Insert entries of one kind at the end of a run's history, and return their numbers.

    Raises:
        InputError: there is no such run.
    """
    if connection.dialect.name == "postgresql":
        # SQLite has a single writer; here two of the same run wait for each other
        connection.execute(select(func.pg_advisory_xact_lock(run)))
    first = last_position(connection, run, place) + 1
    recorded = now()
    entries = [
        {"run_id": run, "position": first + index, "recorded": recorded, **row}
        for index, row in enumerate(rows)
    ]
    query = insert(table).returning(table.id, sort_by_parameter_order=True)
    return [*connection.scalars(query, entries)]


def store(connection: Connection, content: bytes) -> str:
    """Store bytes unless they are there, and return their SHA-256."""
    digest = hashlib.sha256(content).hexdigest()
    if connection.scalar(select(BlobRecord.digest).where(BlobRecord.digest == digest)) is None:
        # another process may just have stored the same
        dialect = sqlite if connection.dialect.name == "sqlite" else postgresql
        row = dialect.insert(BlobRecord).values(digest=digest, content=content)
        connection.execute(row.on_conflict_do_nothing())
    return digest
