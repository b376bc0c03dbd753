"""What was committed survives kills, locks and full disks, and each is told in one clear line."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import psycopg
import pytest
from sqlalchemy import make_url

from merap.errors import StorageError
from merap.knowledge import engine as engines
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.rows import DecisionRow, ObservationRow
from tests.support import knowledge_writer
from tests.support.paths import ROOT

pytestmark = pytest.mark.process

KILLS = 10
STEP = ObservationRow(0, 1, (7, 0, 0), 1, -0.5, 1.0, False)
BRIEF = 0.3


class Writers:
    """Processes that record steps, one after another."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._commands, self._answers = process.stdin, process.stdout
        self._pid = 0
        self._known: list[int] = []

    def start(self, run: int) -> None:
        """Begin, and wait for the first step to be acknowledged."""
        self._known = []
        self._commands.write(f"{run}\n")
        self._commands.flush()
        self._pid = 0
        while not (self._pid and self._known):
            self._read()

    def kill(self) -> list[int]:
        """The steps that were acknowledged before the kill."""
        os.kill(self._pid, signal.SIGKILL)
        while self._pid:
            self._read()
        return self._known

    def _read(self) -> None:
        line = self._answers.readline()
        what, _, number = line.rpartition(" ")
        if what == "pid":
            self._pid = int(number)
        elif what == "exit":
            assert int(number) == -signal.SIGKILL
            self._pid = 0
        else:
            self._known.append(int(number))


@pytest.fixture
def writers(knowledge_url: str) -> Iterator[Writers]:
    command = [sys.executable, "-m", knowledge_writer.__name__, knowledge_url]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, text=True
    ) as process:
        yield Writers(process)
        assert process.stdin is not None
        process.stdin.close()
    assert process.returncode == 0


def test_nothing_acknowledged_is_lost_by_ten_kills_at_random(knowledge_url: str, writers: Writers) -> None:
    with open_knowledge(knowledge_url) as knowledge:
        runs = [knowledge.start_run(f"kill {number}", "case", "digest", {}) for number in range(KILLS)]
    generator = np.random.default_rng()
    for run in runs:
        writers.start(run)
        time.sleep(generator.uniform(0, 0.3))
        known = writers.kill()
        with open_knowledge(knowledge_url, create=False) as knowledge:
            steps = [row.step for row in knowledge.observations(run)]
            decided = [row.data["step"] for row in knowledge.decisions(run)]
            checkpoint = knowledge.latest_checkpoint(run)
            positions = [entry.position for entry in knowledge.history(run)]
        assert known == [*range(len(known))]
        # the kill may come between a commit and its acknowledgement
        assert steps in (known, [*range(len(known) + 1)])
        assert decided == [step for step in steps if step % 3 == 0]
        last = max((step for step in known if step % 3), default=None)
        assert last is None or (checkpoint is not None and checkpoint.episode >= last)
        assert checkpoint is None or checkpoint.state == knowledge_writer.state(checkpoint.episode)
        assert positions == [*range(1, len(positions) + 1)]


@contextmanager
def locked(url: str) -> Iterator[None]:
    """Another connection holds the lock that a writer needs."""
    if url.startswith("sqlite"):
        with closing(sqlite3.connect(make_url(url).database or "", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            yield
            other.execute("ROLLBACK")
    else:
        with psycopg.connect(url) as other:
            other.execute("LOCK TABLE merap.decision IN EXCLUSIVE MODE")
            yield
            other.rollback()


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """A try lasts a tenth of the usual second."""
    monkeypatch.setattr(engines, "LOCK_WAIT_MS", 100)


def test_a_lock_of_another_process_is_waited_for(knowledge_url: str) -> None:
    notices: list[str] = []
    with open_knowledge(knowledge_url, notice=notices.append) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        with locked(knowledge_url):
            writer = threading.Thread(
                target=knowledge.record_decision, args=(run, DecisionRow(0, 0, "replan"))
            )
            writer.start()
            deadline = time.monotonic() + 20
            while not notices and time.monotonic() < deadline:
                time.sleep(0.01)
        writer.join(20)
        assert [row.kind for row in knowledge.decisions(run)] == ["replan"]
        began, ended = notices
        assert "is locked by another process" in began
        assert "trying again for 30 s" in began
        assert "is free again after" in ended


def test_a_lock_that_stays_is_an_error_and_nothing_is_lost(knowledge_url: str) -> None:
    notices: list[str] = []
    with open_knowledge(knowledge_url, lock_timeout=BRIEF, notice=notices.append) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        knowledge.record_observations(run, [STEP])
        with locked(knowledge_url):
            with pytest.raises(
                StorageError, match=r"is locked by another process .*; gave up after"
            ) as error:
                knowledge.record_decision(run, DecisionRow(0, 0, "replan"))
            assert [*knowledge.observations(run)] == [STEP]
        assert str(error.value).startswith(knowledge.place)
        assert "\n" not in str(error.value)
        knowledge.record_decision(run, DecisionRow(0, 0, "replan"))
        assert [row.kind for row in knowledge.decisions(run)] == ["replan"]
        assert len(notices) == 1


@pytest.mark.parametrize("knowledge_url", ["sqlite"], indirect=True)
def test_a_transaction_waits_for_the_lock_before_it_begins(knowledge_url: str) -> None:
    notices: list[str] = []
    with open_knowledge(knowledge_url, lock_timeout=BRIEF, notice=notices.append) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        with locked(knowledge_url), pytest.raises(StorageError, match="gave up"), knowledge.transaction():
            pytest.fail("the transaction has begun")
        with knowledge.transaction():
            knowledge.record_observations(run, [STEP])
        assert [*knowledge.observations(run)] == [STEP]


def fill(knowledge: KnowledgeBase, run: int) -> int:
    """Record until the disk is full; how many steps were committed."""
    rows = [ObservationRow(0, step, (step,), 0, 0.0, 1.0, False) for step in range(100)]
    committed = 0

    def record() -> None:
        nonlocal committed
        for _ in range(1000):
            knowledge.record_observations(run, rows)
            committed += len(rows)

    with pytest.raises(StorageError, match="the disk is full; what was committed is kept") as error:
        record()
    assert str(error.value).startswith(knowledge.place)
    return committed


def test_a_full_disk_is_told_and_what_was_committed_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"sqlite:///{tmp_path / 'knowledge.sqlite'}"
    open_knowledge(url).close()
    with monkeypatch.context() as small:
        # SQLite answers as it does when the disk is full: SQLITE_FULL
        small.setattr(engines, "PRAGMAS", (*engines.PRAGMAS, "max_page_count=100"))
        with open_knowledge(url) as knowledge:
            run = knowledge.start_run("first", "case", "digest", {})
            committed = fill(knowledge, run)
            assert committed > 0
            assert len([*knowledge.observations(run)]) == committed
    with open_knowledge(url) as knowledge:
        assert len([*knowledge.observations(run)]) == committed
        knowledge.record_observations(run, [STEP])
        assert len([*knowledge.observations(run)]) == committed + 1


def test_a_full_disk_of_postgresql_is_told_and_what_was_committed_stays(postgresql_url: str) -> None:
    with open_knowledge(postgresql_url) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})
        with psycopg.connect(postgresql_url, autocommit=True) as server:
            server.execute(
                "CREATE FUNCTION merap.full() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
                "IF NEW.position > 300 THEN RAISE 'no space left' USING ERRCODE = 'disk_full'; END IF; "
                "RETURN NEW; END $$"
            )
            server.execute(
                "CREATE TRIGGER full_disk BEFORE INSERT ON merap.observation "
                "FOR EACH ROW EXECUTE FUNCTION merap.full()"
            )
        assert fill(knowledge, run) == 300
        assert len([*knowledge.observations(run)]) == 300


def test_a_lost_connection_is_told_and_the_next_write_has_another(postgresql_url: str) -> None:
    with open_knowledge(postgresql_url) as knowledge:
        run = knowledge.start_run("first", "case", "digest", {})

        def lose_the_connection() -> None:
            with knowledge.transaction():
                knowledge.record_observations(run, [STEP])
                with psycopg.connect(postgresql_url, autocommit=True) as server:
                    server.execute(
                        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                        "WHERE datname = current_database() AND pid <> pg_backend_pid()"
                    )
                knowledge.record_observations(run, [STEP])

        with pytest.raises(StorageError, match="the connection is lost"):
            lose_the_connection()
        assert [*knowledge.observations(run)] == []
        knowledge.record_observations(run, [STEP])
        assert [*knowledge.observations(run)] == [STEP]


def test_two_processes_may_record_at_once(knowledge_url: str, writers: Writers) -> None:
    with open_knowledge(knowledge_url) as knowledge:
        runs = [knowledge.start_run(f"writer {number}", "case", "digest", {}) for number in range(2)]
        run, other = runs
        writers.start(other)
        for _ in range(20):
            knowledge.record_observations(run, [STEP])
        known = writers.kill()
        assert len([*knowledge.observations(run)]) == 20
        assert len([*knowledge.observations(other)]) >= len(known)
        for number in runs:
            positions = [entry.position for entry in knowledge.history(number)]
            assert positions == [*range(1, len(positions) + 1)]
