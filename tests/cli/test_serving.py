"""`serve`, and the loop on what it serves, as a user calls them."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from merap.learning.config import TrainingConfig
from tests.support.command_line import command, merap
from tests.support.http_servers import free_port
from tests.support.trained_runs import trained

pytestmark = pytest.mark.process

RUNNING = Path("models/running-example")


def error_of(done: subprocess.CompletedProcess[str]) -> str:
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("error: ")
    return done.stderr


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[subprocess.Popen[str], str]]:
    process = subprocess.Popen(
        command("serve", RUNNING, "--port", "0"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    announced = process.stdout.readline()
    url = next(word for word in announced.split() if word.startswith("http://")).rstrip(";")
    assert announced == f"met of running_example on {url}; interrupt to end\n"
    yield process, url
    if process.poll() is None:
        process.kill()
    process.communicate()


@pytest.mark.slow
def test_the_loop_manages_a_system_that_is_served(
    server: tuple[subprocess.Popen[str], str], tmp_path: Path
) -> None:
    _, url = server
    run = trained(tmp_path / "run", TrainingConfig(updates=2, hidden=(4,), episodes=2), RUNNING)
    scenario, report = tmp_path / "elsewhere.yaml", tmp_path / "report.json"
    text = (RUNNING / "elsewhere.yaml").read_text().replace("episodes: 48", "episodes: 2")
    scenario.write_text(text.replace("http://127.0.0.1:3000", url))
    done = merap("run", run.path, "--scenario", scenario, "--json", report, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-2].startswith("2 episodes returned ")
    assert "was possible" not in lines[-2]
    assert lines[-1].startswith("0 re-plannings, 2 policy updates, ")
    assert len(json.loads(report.read_text())["episodes"]) == 2
    assert httpx.get(url + "/monitor", trust_env=False).json()["episode"] == 3
    scenario.write_text(text.replace(":3000", f":{free_port()}"))
    nobody = merap("run", run.path, "--scenario", scenario)
    assert nobody.returncode == 3
    assert error_of(nobody).startswith("error: refused: http://127.0.0.1:")


def test_a_port_that_is_taken_is_one_clear_line(server: tuple[subprocess.Popen[str], str]) -> None:
    port = server[1].rpartition(":")[2]
    done = merap("serve", RUNNING, "--port", port)
    assert done.returncode == 2
    assert f"can't listen on port {port} of 127.0.0.1: Address already in use" in error_of(done)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--system", "nowhere"], "nowhere"),
        (["--scenario", "models/running-example/three-changes.yaml", "--slip", "0.1"], "give none"),
        (["--deadline", "1"], "--deadline and --fallback belong together"),
        (["--slip", "1"], r"must be in [0, 1), it is 1.0"),
    ],
)
def test_what_can_not_be_served_is_one_clear_line(options: list[str], message: str) -> None:
    done = merap("serve", RUNNING, *options)
    assert done.returncode == 2
    assert message in error_of(done)
    assert done.stdout == ""


def test_requests_are_logged_and_an_interrupt_ends_it(server: tuple[subprocess.Popen[str], str]) -> None:
    """The last test of the module: it ends the server."""
    process, url = server
    httpx.put(url + "/execute", json={"action": "fly"}, trust_env=False)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert out == "ended\n"
    assert "INFO executed {'action': None, 'reset': True" in err
    assert "WARNING refused: the body is not as asked in 'action': 'fly'" in err
    assert "Traceback" not in err
