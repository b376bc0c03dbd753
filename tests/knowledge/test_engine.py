"""Which URLs and files can be a knowledge base, and what the others are told."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from merap.errors import InputError, MerapError, StorageError
from merap.knowledge import engine as engines
from merap.knowledge.base import open_knowledge
from merap.knowledge.engine import default_url, make_engine, read_url


def refused(url: str, *, create: bool = True) -> str:
    with pytest.raises(InputError) as error:
        open_knowledge(url, create=create)
    line = str(error.value)
    assert "\n" not in line
    return line


def test_the_default_is_a_file_in_the_folder_of_the_run(tmp_path: Path) -> None:
    with open_knowledge(default_url(tmp_path)) as knowledge:
        assert knowledge.place == str(tmp_path / "knowledge.db")
    assert (tmp_path / "knowledge.db").read_bytes().startswith(b"SQLite format 3\0")


@pytest.mark.parametrize(
    "url",
    ["knowledge.sqlite", "sqlite://", "sqlite:///:memory:", "mysql://root@localhost/x", "sqlite:///a?b=c"],
)
def test_urls_that_can_not_be_one_are_told_what_can(url: str) -> None:
    assert "expected sqlite:///FILE or postgresql://USER@HOST/DATABASE" in refused(url)


def test_postgresql_without_its_driver_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "find_spec", lambda name: None)
    assert "pip install 'merap[postgresql]'" in refused("postgresql://me:secret@127.0.0.1/x")


def test_no_password_is_shown() -> None:
    url = "postgresql+psycopg://me:secret@127.0.0.1:1/x"
    assert read_url(url).place == "postgresql://me:***@127.0.0.1:1/x"
    with pytest.raises(StorageError, match=r"127\.0\.0\.1") as error:
        open_knowledge(url)
    assert "secret" not in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_none_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("mine\n" * 1000)
    assert "notes.txt: is damaged, or no knowledge base" in refused(f"sqlite:///{path}")
    assert path.read_text() == "mine\n" * 1000
    assert [entry.name for entry in tmp_path.iterdir()] == ["notes.txt"]


def test_a_database_of_something_else_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "other.sqlite"
    with closing(sqlite3.connect(path)) as other:
        other.execute("CREATE TABLE run (id INTEGER)")
    before = path.read_bytes()
    assert "is a SQLite database of something else" in refused(f"sqlite:///{path}")
    assert path.read_bytes() == before


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "knowledge.sqlite"
    with open_knowledge(f"sqlite:///{path}") as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        knowledge.record_model(run, "model", bytes(100_000))
    content = path.read_bytes()
    path.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    assert "knowledge.sqlite: is damaged, or no knowledge base" in refused(f"sqlite:///{path}")


def test_a_damaged_blob_is_named(knowledge_url: str) -> None:
    with open_knowledge(knowledge_url) as knowledge:
        engine = make_engine(read_url(knowledge_url))
        with engine.begin() as connection:
            connection.execute(
                text("INSERT INTO blob (digest, content) VALUES (:digest, :content)"),
                {"digest": "0" * 64, "content": b"something else"},
            )
        engine.dispose()
        with pytest.raises(InputError, match=f"the blob {'0' * 64} is damaged"):
            knowledge.blob("0" * 64)
        with pytest.raises(InputError, match=f"the blob {'1' * 64} is missing"):
            knowledge.blob("1" * 64)


@pytest.mark.parametrize(
    ("path", "complaint"),
    [("missing/knowledge.sqlite", "there is no folder"), (".", "is a folder, expected the file")],
)
def test_places_where_no_file_can_be(tmp_path: Path, path: str, complaint: str) -> None:
    assert complaint in refused(f"sqlite:///{tmp_path / path}")


def test_one_that_is_missing_is_not_made_on_request(knowledge_url: str, tmp_path: Path) -> None:
    assert "there is no knowledge base" in refused(knowledge_url, create=False)
    assert [*tmp_path.iterdir()] == []
    assert "there is no knowledge base" in refused(knowledge_url, create=False)


def test_an_empty_file_becomes_one_only_if_it_may(tmp_path: Path) -> None:
    path = tmp_path / "knowledge.sqlite"
    path.touch()
    assert "there is no knowledge base" in refused(f"sqlite:///{path}", create=False)
    with open_knowledge(f"sqlite:///{path}") as knowledge:
        assert knowledge.runs() == ()


def test_sqlite_flushes_every_commit(tmp_path: Path) -> None:
    engine = make_engine(read_url(f"sqlite:///{tmp_path / 'knowledge.sqlite'}"))
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1
    engine.dispose()


def test_both_kinds_of_fault_are_of_merap() -> None:
    assert issubclass(StorageError, MerapError)
    assert (InputError.exit_code, StorageError.exit_code) == (2, 3)
