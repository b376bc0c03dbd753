"""Secrets of systems, of environments and of knowledge bases are in nothing that a run leaves behind."""

from __future__ import annotations

import json
import sqlite3
import sys
from base64 import b64encode
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from merap.mapek.scenario import read_scenario
from merap.runs.run_folder import RunFolder
from tests.support.command_line import merap
from tests.support.guarded_server import GuardedServer
from tests.support.http_servers import raw_server, served_system
from tests.support.postgresql_server import role_with_password
from tests.support.trained_runs import SMALL, trained

PASSWORD, TOKEN, KEY, OF_DATABASE = "rb0w@s3cret-1", "t0k-s3cret-2", "k3y-s3cret-3", "dt4b@s3cret-4"
SECRETS = [*(text for one in (PASSWORD, OF_DATABASE) for text in one.split("@")), TOKEN, KEY]
AUTHORIZATION = f"Basic {b64encode(f'me:{PASSWORD}'.encode()).decode()}"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run", SMALL)


@pytest.fixture
def guarded(run: RunFolder) -> Iterator[tuple[str, GuardedServer]]:
    """The URL of a system that wants a password and a token, and repeats them when it fails."""
    served = served_system(run.case.system("met"))
    server = GuardedServer(served, authorization=AUTHORIZATION, query=f"token={TOKEN}")
    with raw_server(server) as url:
        yield f"{url.replace('//', f'//me:{PASSWORD}@')}?token={TOKEN}", server


def scenario(folder: Path, system: str, episodes: int = 2) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(
        f"scenario: hidden\nsystem: {system}\nepisodes: {episodes}\nstrategy: {{name: retrieval}}\n", "utf-8"
    )
    return path


def everything_in(folder: Path) -> str:
    """All files of a folder and below, the tables of its databases among them, but the scenario itself."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != "scenario.yaml":
            found.append(path.name + path.read_bytes().decode("latin-1"))
        if path.suffix == ".db":
            with closing(sqlite3.connect(path)) as connection:
                found += connection.iterdump()
    return "\n".join(found)


def told(*arguments: object, code: int = 0) -> str:
    done = merap(*arguments)
    assert done.returncode == code, done
    return done.stdout + done.stderr


def require_hidden(text: str) -> None:
    assert not [secret for secret in (*SECRETS, AUTHORIZATION[6:]) if secret in text]


def test_nothing_that_a_run_leaves_behind_has_the_secrets_of_its_system(
    run: RunFolder, guarded: tuple[str, GuardedServer], tmp_path: Path
) -> None:
    url, server = guarded
    path = scenario(tmp_path, f"{{url: '{url}', retries: 0}}", episodes=6)
    db, log, out = tmp_path / "k.db", tmp_path / "events.jsonl", tmp_path / "out"
    arguments = ("run", run.path, "--scenario", path, "--db", db, "--log", log)
    server.out_of_order = 60  # in some later episode, for good
    text = told(*arguments, "-o", out, code=3)
    assert "no power" in text
    server.out_of_order = 10**9
    text += told(*arguments, "--resume", "--json", tmp_path / "report.json")
    for verb in (
        ["list"],
        ["show", 1],
        ["show", 1, "--json", "-"],
        ["replay", 1],
        ["replay", 1, "--check", run.path],
    ):
        text += told("knowledge", *verb, "--db", db)
    text += told("knowledge", "export", 1, "--db", db, "-o", tmp_path / "exported")
    assert f"http://***@{urlsplit(url).hostname}" in text
    require_hidden(text)
    require_hidden(everything_in(tmp_path))
    require_hidden(everything_in(run.path))
    read = read_scenario(path)
    require_hidden(f"{read!r} {read.spec!r} {read.document!r} {read.settings()!r}")


def test_the_password_of_a_knowledge_base_is_in_nothing_that_a_run_leaves_behind(
    run: RunFolder, tmp_path: Path, postgresql_url: str
) -> None:
    place = role_with_password(postgresql_url, OF_DATABASE)
    db = f"postgresql://robot:{OF_DATABASE}@{place}?sslpassword={KEY}"
    path, log = scenario(tmp_path, "met"), tmp_path / "events.jsonl"
    text = told("run", run.path, "--scenario", path, "--db", db, "--log", log, "-o", tmp_path / "out")
    for verb in (["list"], ["show", 1, "--json", "-"], ["replay", 1], ["show", 9]):
        done = merap("knowledge", *verb, "--db", db)
        text += done.stdout + done.stderr
    text += told("knowledge", "export", 1, "--db", db, "-o", tmp_path / "exported")
    assert "postgresql://robot:***@" in text
    require_hidden(text)
    require_hidden(everything_in(tmp_path))


def test_secrets_among_the_arguments_of_an_environment_are_not_recorded(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needs_a_key.py").write_text(
        """
import gymnasium
from merap.mdp.gymnasium_env import MDPEnv
from tests.support.grid_tasks import grid_model, grid_task

class Keyed(MDPEnv):
    def __init__(self, api_key, url):
        super().__init__(grid_model(grid_task((4, 4))), 18)
        self.key = api_key, url
    def step(self, action):
        raise RuntimeError(f"{self.key} {self.key[0]} can't log in")

gymnasium.register("Keyed-v0", entry_point=Keyed)
"""
    )
    monkeypatch.syspath_prepend(tmp_path)
    given = json.dumps({"api_key": KEY, "url": f"https://me:{PASSWORD}@there/x?token={TOKEN}"})
    path = scenario(tmp_path, f"{{gymnasium: 'needs_a_key:Keyed-v0', arguments: {given}}}")
    db, log = tmp_path / "k.db", tmp_path / "events.jsonl"
    text = told("run", run.path, "--scenario", path, "--db", db, "--log", log, "--json", "-")
    text += told("knowledge", "show", 1, "--db", db)
    assert "can't log in" in log.read_text()
    require_hidden(text + log.read_text() + "".join(closing_dump(db)))
    wrong = scenario(tmp_path, f"{{gymnasium: FrozenLake-v1, arguments: {given}}}")
    require_hidden(told("run", run.path, "--scenario", wrong, "--db", db, "--log", log, code=2))
    require_hidden(log.read_text())
    sys.modules.pop("needs_a_key")


def closing_dump(db: Path) -> list[str]:
    with closing(sqlite3.connect(db)) as connection:
        return list(connection.iterdump())


@pytest.mark.parametrize(
    "system",
    [
        "'http://me:{0}@host'",
        "['http://me:{0}@host']",
        "{{url: ['http://me:{0}@host']}}",
        "{{url: 'http://me:{0}@host', timeout: 'http://me:{0}@host'}}",
        "{{url: 'http://me:{0}@host', 'http://me:{0}@host': 1}}",
        "{{url: '{1}http://me:{0}@host', horizon: {1}}}",
        "{{gymnasium: 'http://me:{0}@host'}}",
        "{{environment: 'http://me:{0}@host'}}",
        "{{url: http://me:{0}@host: 3000}}",
        "{{url: 'http://me:{0}@host'",
        "{{url: 'http://host/?token={0}&{1}', wrong: 'http://host/?token={0}'}}",
    ],
)
@pytest.mark.parametrize("secret", [PASSWORD, TOKEN])
def test_a_scenario_that_is_wrong_is_told_without_its_secrets(
    run: RunFolder, tmp_path: Path, system: str, secret: str
) -> None:
    path = scenario(tmp_path, system.format(secret, "x" * 90))
    text = told(
        "run", run.path, "--scenario", path, "--db", tmp_path / "k.db", "--log", tmp_path / "log", code=2
    )
    assert len(text.strip().splitlines()) == 1
    require_hidden(text)
    require_hidden(everything_in(tmp_path))
