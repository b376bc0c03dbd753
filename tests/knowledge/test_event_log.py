"""Events as JSON lines in a file, and in the knowledge base."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from merap.errors import StorageError
from merap.knowledge import engine
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.event_log import EventLog, JsonLines, plain
from merap.knowledge.rows import EventRow


@pytest.fixture
def lines(tmp_path: Path) -> Iterator[JsonLines]:
    with JsonLines(tmp_path / "events.jsonl") as opened:
        yield opened


@pytest.fixture
def knowledge(tmp_path: Path, lines: JsonLines, monkeypatch: pytest.MonkeyPatch) -> Iterator[KnowledgeBase]:
    """One that gives up soon, and tells the file so."""
    monkeypatch.setattr(engine, "LOCK_WAIT_MS", 10)
    url = engine.default_url(tmp_path)
    with open_knowledge(url, lock_timeout=0.02, notice=lines.notice) as opened:
        opened.start_run("first", "case", "digest", {})
        yield opened


def read(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def test_an_event_is_a_line_and_a_row(tmp_path: Path, lines: JsonLines, knowledge: KnowledgeBase) -> None:
    before = datetime.now(UTC)
    EventLog(lines, knowledge, 1).event("monitor", "warning", "an answer\nis late", ms=12, over=np.True_)
    (line,), (row,) = read(tmp_path), knowledge.events(1)
    assert list(line) == ["time", "component", "level", "message", "data"]
    assert row == EventRow(
        datetime.fromisoformat(str(line["time"])),
        "monitor",
        "warning",
        "an answer is late",
        {"ms": 12, "over": True},
    )
    assert (line["component"], line["level"]) == (row.component, row.level)
    assert (line["message"], line["data"]) == (row.message, row.data)
    assert before <= row.time <= datetime.now(UTC)


def test_data_of_any_kind_has_a_form_in_json() -> None:
    given = {
        "none": None,
        "nan": float("nan"),
        "infinite": -np.inf,
        "number": np.float64(0.1),
        "whole": np.int64(2**40),
        "array": np.array([[1.0, np.inf]]),
        "nested": {1: ({True}, [Path("x")])},
    }
    expected = {
        "none": None,
        "nan": "nan",
        "infinite": "-inf",
        "number": 0.1,
        "whole": 2**40,
        "array": [[1.0, "inf"]],
        "nested": {"1": ["{True}", ["x"]]},
    }
    assert plain(given) == expected
    assert json.loads(json.dumps(plain(given), allow_nan=False)) == expected


def test_a_line_cut_short_by_a_kill_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text('{"whole": 1}\n{"cut": ')
    with JsonLines(path) as lines:
        lines.notice("going on")
    with JsonLines(path) as lines:
        lines.notice("and on")
    first, cut, *rest = path.read_text().splitlines()
    assert (first, cut) == ('{"whole": 1}', '{"cut": ')
    assert [json.loads(line)["message"] for line in rest] == ["going on", "and on"]


def test_events_wait_while_the_knowledge_base_is_locked(
    tmp_path: Path, lines: JsonLines, knowledge: KnowledgeBase
) -> None:
    log = EventLog(lines, knowledge, 1)
    with closing(sqlite3.connect(knowledge.place, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        log.event("monitor", "info", "one")
        log.event("monitor", "info", "two")
        assert [*knowledge.events(1)] == []
        other.execute("ROLLBACK")
    log.event("monitor", "info", "three")
    assert [row.message for row in knowledge.events(1)] == ["one", "two", "three"]
    told = [str(line["message"]) for line in read(tmp_path)]
    assert [line for line in told if line in {"one", "two", "three"}] == ["one", "two", "three"]
    assert any("is locked by another process" in line and "1 events wait" in line for line in told)
    assert any("2 events wait" in line for line in told)


def test_too_many_waiting_events_are_an_error(lines: JsonLines, knowledge: KnowledgeBase) -> None:
    log = EventLog(lines, knowledge, 1, most_waiting=1)
    with closing(sqlite3.connect(knowledge.place, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        log.event("monitor", "info", "one")
        with pytest.raises(StorageError, match="is locked by another process"):
            log.event("monitor", "info", "two")
        other.execute("ROLLBACK")
    log.flush()
    assert [row.message for row in knowledge.events(1)] == ["one", "two"]


def test_threads_lose_no_event(tmp_path: Path, lines: JsonLines, knowledge: KnowledgeBase) -> None:
    log = EventLog(lines, knowledge, 1)

    def tell(name: int) -> None:
        for number in range(10):
            log.event(f"thread {name}", "info", f"event {number}")

    with ThreadPoolExecutor(3) as threads:
        list(threads.map(tell, range(3)))
    recorded = [(row.component, row.message) for row in knowledge.events(1)]
    expected = {(f"thread {name}", f"event {number}") for name in range(3) for number in range(10)}
    assert len(recorded) == len(expected) == len(read(tmp_path))
    assert set(recorded) == expected


def test_an_error_that_ends_it_all_is_the_last_line(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"

    def fail(where: Path) -> None:
        with JsonLines(where):
            raise StorageError("the disk is full")

    for where in (path, Path("/dev/full")):
        with pytest.raises(StorageError, match="the disk is full"):
            fail(where)
    (line,) = read(tmp_path)
    assert (line["component"], line["level"], line["message"]) == ("run", "error", "the disk is full")


def test_a_file_that_can_not_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=f"{tmp_path}/missing/x: can't be written: No such file"):
        JsonLines(tmp_path / "missing" / "x")
    # a device that is always full
    with JsonLines(Path("/dev/full")) as full, pytest.raises(StorageError, match="No space left on device"):
        full.notice("anything")
