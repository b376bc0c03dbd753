"""The schema is versioned, and the database itself refuses to change what is recorded."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

import psycopg
import pytest
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, make_url, text
from sqlalchemy.exc import DBAPIError

from merap.errors import InputError, StorageError
from merap.knowledge.base import open_knowledge
from merap.knowledge.engine import for_writing, make_engine, read_url
from merap.knowledge.rows import DecisionRow, EventRow, ObservationRow, now
from merap.knowledge.schema import SCRIPTS, current_schema, migrate
from merap.knowledge.tables import HISTORY, SCHEMA, Base, RunRecord
from merap.knowledge.writing import insert_row, store

TABLES = ("run", "blob", *(table.__tablename__ for table in HISTORY))


@pytest.fixture
def engine(knowledge_url: str) -> Iterator[Engine]:
    """To a knowledge base with a row in every table, around the API."""
    with open_knowledge(knowledge_url) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        knowledge.record_policy(run, "meta", 0, b"tensors", knowledge.record_model(run, "model", b"umb"))
        knowledge.record_observations(run, [ObservationRow(0, 0, (1,), None, 0.0, 1.0, False)])
        knowledge.record_decision(run, DecisionRow(0, 0, "replan"))
        knowledge.record_event(run, EventRow(now(), "monitor", "info", "seen"))
        knowledge.record_checkpoint(run, 0, b"state")
        knowledge.finish_run(run, {})
    made = make_engine(read_url(knowledge_url))
    yield made
    made.dispose()


def execute(engine: Engine, statement: str) -> None:
    with for_writing(engine).begin() as connection:
        connection.execute(text(statement))


def test_the_newest_schema_is_that_of_the_models(engine: Engine) -> None:
    config = Config()
    config.set_main_option("script_location", SCRIPTS)
    assert ScriptDirectory.from_config(config).get_current_head() == SCHEMA
    with engine.connect() as connection:
        assert current_schema(connection) == SCHEMA
        found = MigrationContext.configure(connection)
        assert compare_metadata(found, Base.metadata) == []


def test_an_older_schema_is_migrated_and_its_rows_are_kept(knowledge_url: str) -> None:
    engine = make_engine(read_url(knowledge_url))
    with for_writing(engine).begin() as connection:
        migrate(connection, "here", target="0001")
        assert current_schema(connection) == "0001"
    insert = """INSERT INTO run (id, name, "case", digest, settings, started)
        VALUES (7, 'old', 'case', 'digest', '{"seed": 3}', '2026-01-01 00:00:00.000000')"""
    execute(engine, insert)
    execute(engine, "UPDATE run SET name = 'older'")
    with open_knowledge(knowledge_url, create=False) as knowledge:
        (run,) = knowledge.runs()
        assert (run.id, run.name, run.settings) == (7, "older", {"seed": 3})
    with pytest.raises(DBAPIError, match="append-only"):
        execute(engine, "UPDATE run SET name = 'oldest'")
    engine.dispose()


def append_checkpoint(engine: Engine, run: int, position: int, episode: int) -> None:
    digest = hashlib.sha256(b"state").hexdigest()
    execute(
        engine,
        f"""INSERT INTO checkpoint (run_id, position, recorded, episode, digest)
        VALUES ({run}, {position}, '2026-01-01 00:00:00.000000', {episode}, '{digest}')""",
    )


def old_engine(url: str, episodes: Sequence[int]) -> Engine:
    """To a database before checkpoints were unique, with two runs that have these."""
    engine = make_engine(read_url(url))
    with for_writing(engine).begin() as connection:
        migrate(connection, "here", target="0002")
        store(connection, b"state")
        for name in ("first", "second"):
            row: dict[str, Any] = {"name": name, "case": "case", "digest": "digest", "settings": {}}
            insert_row(connection, RunRecord, {**row, "started": now()})
    for number, episode in enumerate(episodes):
        append_checkpoint(engine, 1, number + 1, episode)
        append_checkpoint(engine, 2, number + 1, number)
    return engine


@pytest.mark.parametrize("episodes", [[0, 1, 2], [0, 1, 1]])
def test_from_now_on_an_episode_has_one_checkpoint(knowledge_url: str, episodes: list[int]) -> None:
    """Also where two processes have gone on with a run before: its rows stay, and all can be opened."""
    engine = old_engine(knowledge_url, episodes)
    with open_knowledge(knowledge_url) as knowledge:
        assert (knowledge.counts(1)["checkpoint"], knowledge.counts(2)["checkpoint"]) == (3, 3)
        knowledge.record_checkpoint(2, 3, b"state")
        with pytest.raises(StorageError, match="another process goes on with this run") as taken:
            knowledge.record_checkpoint(2, 3, b"other state")
        assert "\n" not in str(taken.value)
        assert knowledge.counts(2)["checkpoint"] == 4
        knowledge.record_checkpoint(1, 3, b"state")
    with pytest.raises(DBAPIError, match="checkpoint_episode"):
        append_checkpoint(engine, 1, 99, 3)
    engine.dispose()


def test_a_newer_schema_is_refused_in_one_line(engine: Engine, knowledge_url: str) -> None:
    execute(engine, "UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(
        InputError, match=r"has schema 9999, .* knows 0001 to 0003; use a newer merap"
    ) as newer:
        open_knowledge(knowledge_url)
    assert "\n" not in str(newer.value)


def test_no_row_is_changed_or_removed(engine: Engine) -> None:
    for table in TABLES:
        column = "digest" if table == "blob" else "id"
        for statement in (f"UPDATE {table} SET {column} = {column}", f"DELETE FROM {table}"):
            with pytest.raises(DBAPIError, match="append-only: record a correction as a new row"):
                execute(engine, statement)
        with engine.connect() as connection:
            assert connection.scalar(text(f"SELECT count(*) FROM {table}"))


def test_no_table_of_postgresql_is_truncated(postgresql_url: str) -> None:
    open_knowledge(postgresql_url).close()
    for table in TABLES:
        with psycopg.connect(postgresql_url) as connection, pytest.raises(psycopg.Error, match="append-only"):
            connection.execute(f"TRUNCATE merap.{table} CASCADE".encode())


@pytest.mark.parametrize("knowledge_url", ["sqlite"], indirect=True)
def test_no_row_of_sqlite_is_replaced(engine: Engine, knowledge_url: str) -> None:
    engine.dispose()
    with closing(sqlite3.connect(make_url(knowledge_url).database or "")) as file:
        for table in TABLES:
            same = "digest, x'00'" if table == "blob" else "*"
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                file.execute(f"INSERT OR REPLACE INTO {table} SELECT {same} FROM {table}")
        file.execute("INSERT OR REPLACE INTO blob SELECT * FROM blob")


@pytest.mark.parametrize("knowledge_url", ["sqlite"], indirect=True)
def test_no_checkpoint_of_sqlite_is_replaced(engine: Engine, knowledge_url: str) -> None:
    engine.dispose()
    replace = """INSERT OR REPLACE INTO checkpoint
        SELECT id + 1, run_id, position + 1, recorded, episode, digest FROM checkpoint"""
    with closing(sqlite3.connect(make_url(knowledge_url).database or "")) as file:
        with pytest.raises(sqlite3.IntegrityError, match="checkpoint_episode"):
            file.execute(replace)
        assert file.execute("SELECT id FROM checkpoint").fetchall() == [(1,)]


@pytest.mark.parametrize("knowledge_url", ["sqlite"], indirect=True)
def test_no_place_in_a_history_of_sqlite_is_taken_twice(engine: Engine, knowledge_url: str) -> None:
    engine.dispose()
    insert = """INSERT OR REPLACE INTO decision
        SELECT id + 1, run_id, position, recorded, episode, step, kind, reasons, data FROM decision"""
    with closing(sqlite3.connect(make_url(knowledge_url).database or "")) as file:
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            file.execute(insert)
        file.execute(insert.replace("position,", "position + 1,", 1))
        assert file.execute("SELECT count(*) FROM decision").fetchone() == (2,)
