"""Keep an append-only history of runs in a database.

A correction is a new row. Nothing here updates or deletes, and triggers in the database refuse both.
"""

from __future__ import annotations

import hashlib
import heapq
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from sqlalchemy import Connection, select

from merap.errors import InputError, MerapError
from merap.knowledge import tables
from merap.knowledge.engine import read_url, require_ours
from merap.knowledge.reading import count, last_position, read_page, read_runs
from merap.knowledge.rows import (
    Checkpoint,
    DecisionRow,
    Entry,
    EventRow,
    ModelRow,
    ObservationRow,
    PolicyKind,
    PolicyRow,
    RunRow,
    now,
)
from merap.knowledge.schema import current_schema, migrate
from merap.knowledge.store import Store
from merap.knowledge.writing import append, insert_row, store

KINDS: Mapping[str, type[tables.History]] = {table.__tablename__: table for table in tables.HISTORY}
LOCK_TIMEOUT = 30.0
_logger = logging.getLogger(__name__)


def open_knowledge(
    url: str,
    *,
    create: bool = True,
    lock_timeout: float = LOCK_TIMEOUT,
    notice: Callable[[str], None] = _logger.warning,
) -> KnowledgeBase:
    """Open a knowledge base; one of an older schema is migrated.

    Args:
        url: `sqlite:///FILE` or `postgresql://USER@HOST/DATABASE`.
        create: whether one that is missing is made.
        lock_timeout: seconds to wait for a lock that another process holds.
        notice: is told of such waiting, in one line.

    Raises:
        InputError: the URL, file or schema is none that can be used.
        StorageError: it can't be opened now.
    """
    read = read_url(url)
    require_ours(read, create=create)
    opened = Store(read, lock_timeout, notice)
    try:
        found = opened.read(current_schema)
        if found is None and not create:
            raise InputError("there is no knowledge base", source=opened.place)
        if found != tables.SCHEMA:
            opened.write(partial(migrate, place=opened.place))
    except MerapError:
        opened.close()
        raise
    return KnowledgeBase(opened)


class KnowledgeBase(AbstractContextManager["KnowledgeBase"]):
    """An open knowledge base; see `open_knowledge`. Several threads may use it, one at a time.

    A record is committed when the method returns, unless it is called inside
    `with knowledge.transaction():`. All of them raise StorageError if the database can't be read
    or written, and InputError if there is no such run.
    """

    def __init__(self, opened: Store) -> None:
        self._store = opened

    @property
    def place(self) -> str:
        """The file or URL, without a password."""
        return self._store.place

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the connections back."""
        self._store.close()

    def transaction(self) -> AbstractContextManager[None]:
        """Commit what the block records at its end, or nothing of it; one inside another joins it."""
        return self._store.transaction()

    def start_run(self, name: str, case: str, digest: str, settings: Mapping[str, Any]) -> int:
        """Record that a run begins, and return its number.

        Args:
            name: given by the user.
            case: name of the case.
            digest: digest of the case.
            settings: as JSON.
        """
        row = {"name": name, "case": case, "digest": digest, "settings": settings, "started": now()}
        return self._store.write(partial(insert_row, table=tables.RunRecord, row=row))

    def record_model(self, run: int, name: str, umb: bytes) -> int:
        """Record a model (a UMB archive), and return its number."""
        return self._record(run, tables.ModelRecord, {"name": name}, umb)

    def record_policy(
        self, run: int, kind: PolicyKind, step: int, tensors: bytes, model: int | None = None
    ) -> int:
        """Record a policy, and return its number.

        Args:
            run: number of the run.
            kind: `meta` or `adapted`.
            step: policy updates so far.
            tensors: safetensors.
            model: the number of the model that it was made for.
        """
        return self._record(
            run, tables.PolicyRecord, {"kind": kind, "step": step, "model_id": model}, tensors
        )

    def record_observations(self, run: int, rows: Sequence[ObservationRow]) -> None:
        """Record observations, in this order."""
        if rows:
            self._append(run, tables.ObservationRecord, [vars(row) for row in rows])

    def record_decision(self, run: int, row: DecisionRow) -> int:
        """Record a decision with its reasons, and return its number."""
        return self._record(run, tables.DecisionRecord, vars(row))

    def record_event(self, run: int, row: EventRow) -> int:
        """Record a line of the log, and return its number."""
        return self._record(run, tables.EventRecord, vars(row))

    def record_checkpoint(self, run: int, episode: int, state: bytes) -> int:
        """Record a state to go on from after a number of episodes, and return its own number.

        Raises:
            StorageError: there is one already, so another process goes on with this run.
        """
        return self._record(run, tables.CheckpointRecord, {"episode": episode}, state)

    def finish_run(self, run: int, report: Mapping[str, Any]) -> None:
        """Record how a run ended; of several reports the last one holds."""
        self._record(run, tables.ReportRecord, {"report": report})

    def latest_checkpoint(self, run: int) -> Checkpoint | None:
        """Return the last state that was recorded; None if there is none."""
        self._require(run)
        table = tables.CheckpointRecord
        query = (
            select(table.episode, table.digest)
            .where(table.run_id == run)
            .order_by(table.position.desc())
            .limit(1)
        )
        found = self._store.read(lambda connection: connection.execute(query).one_or_none())
        return None if found is None else Checkpoint(found.episode, self.blob(found.digest))

    def blob(self, digest: str) -> bytes:
        """Return the bytes with that SHA-256.

        Raises:
            InputError: there are none, or they are damaged.
        """
        query = select(tables.BlobRecord.content).where(tables.BlobRecord.digest == digest)
        content = self._store.read(lambda connection: connection.scalar(query))
        if content is None or hashlib.sha256(content).hexdigest() != digest:
            damage = "missing" if content is None else "damaged"
            raise InputError(f"the blob {digest} is {damage}", source=self.place)
        return content

    def runs(self) -> tuple[RunRow, ...]:
        """Return all runs, in order of their numbers."""
        return self._store.read(read_runs)

    def run(self, run: int) -> RunRow:
        """Return a run."""
        found = self._store.read(partial(read_runs, run=run))
        if not found:
            raise InputError(f"there is no run {run}", source=self.place)
        return found[0]

    def counts(self, run: int) -> Mapping[str, int]:
        """Count the entries of each kind that a run has."""
        self._require(run)
        return {name: self._store.read(partial(count, table=table, run=run)) for name, table in KINDS.items()}

    def observations(self, run: int) -> Iterator[ObservationRow]:
        """Iterate over the observations, in order."""
        rows = (entry.row for entry in self.history(run, ("observation",)))
        return (row for row in rows if isinstance(row, ObservationRow))

    def decisions(self, run: int) -> Iterator[DecisionRow]:
        """Iterate over the decisions, in order."""
        rows = (entry.row for entry in self.history(run, ("decision",)))
        return (row for row in rows if isinstance(row, DecisionRow))

    def events(self, run: int) -> Iterator[EventRow]:
        """Iterate over the log, in order."""
        rows = (entry.row for entry in self.history(run, ("event",)))
        return (row for row in rows if isinstance(row, EventRow))

    def models(self, run: int) -> tuple[ModelRow, ...]:
        """Return the models, in order."""
        rows = (entry.row for entry in self.history(run, ("model",)))
        return tuple(row for row in rows if isinstance(row, ModelRow))

    def policies(self, run: int) -> tuple[PolicyRow, ...]:
        """Return the policies, in order."""
        rows = (entry.row for entry in self.history(run, ("policy",)))
        return tuple(row for row in rows if isinstance(row, PolicyRow))

    def history(self, run: int, kinds: Sequence[str] = tuple(KINDS)) -> Iterator[Entry]:
        """Iterate over entries in the order in which they were recorded.

        Args:
            run: number of the run.
            kinds: names of `KINDS`; all by default.
        """
        self._require(run)
        streams = [self._entries(KINDS[kind], run) for kind in kinds]
        return heapq.merge(*streams, key=lambda entry: entry.position)

    def _require(self, run: int) -> None:
        self._store.read(partial(last_position, run=run, place=self.place))

    def _entries(self, table: type[tables.History], run: int) -> Iterator[Entry]:
        # page by page: one long transaction of a reader would let SQLite's log grow
        page = self._store.read(partial(read_page, table=table, run=run, after=0))
        while page:
            yield from page
            page = self._store.read(partial(read_page, table=table, run=run, after=page[-1].position))

    def _record(
        self, run: int, table: type[tables.History], row: Mapping[str, Any], blob: bytes | None = None
    ) -> int:
        (number,) = self._append(run, table, [row], blob)
        return number

    def _append(
        self,
        run: int,
        table: type[tables.History],
        rows: Sequence[Mapping[str, Any]],
        blob: bytes | None = None,
    ) -> list[int]:
        def work(connection: Connection) -> list[int]:
            stored = {} if blob is None else {"digest": store(connection, blob)}
            return append(connection, table, run, [{**row, **stored} for row in rows], self.place)

        return self._store.write(work)
