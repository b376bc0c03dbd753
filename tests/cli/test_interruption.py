"""Ctrl-C and termination at any moment: exit 130, one line, nothing half-written."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from merap.families.folder import STAGING
from tests.support.command_line import command, merap
from tests.support.loop_runs import MOVED
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, SMALL, contents, trained, what_was_learned

RUNNING = MODELS / "running-example"
LONG = ["--updates", "100000", "--set", "hidden=[4]", "--set", "episodes=5"]
pytestmark = pytest.mark.process

RUN_VALIDATE = (
    f"import sys; sys.argv[1:] = ['validate', {str(RUNNING)!r}]; from merap.cli.main import main; main()"
)
SOON = 100.0  # seconds, on a machine however busy: it ends, and how soon is no matter of a test


def interrupted(
    arguments: list[object],
    when: Callable[[], bool],
    number: signal.Signals = signal.SIGINT,
    **environment: str,
) -> str:
    """Send a signal to `merap` at a moment; the line that it ends with."""
    process = subprocess.Popen(
        command(*arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    deadline = time.monotonic() + 300
    while not (watches_signals(process) and when()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)
    sent = time.monotonic()
    out, err = process.communicate(timeout=SOON)
    assert time.monotonic() - sent < SOON
    assert (process.returncode, out) == (130, ""), err
    told, _, line = err.rstrip("\n").rpartition("\n")
    assert "Traceback" not in told
    return line


def watches_signals(process: subprocess.Popen[str]) -> bool:
    """Tell whether merap's first line has run; the interpreter's own start is not ours to interrupt."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) & 1 << (signal.SIGTERM - 1))


def is_running(process: int) -> bool:
    """Tell whether a process is there and no zombie."""
    try:
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False
    return state.rpartition(")")[2].split()[0] != "Z"


def after(seconds: float) -> Callable[[], bool]:
    moment = time.monotonic() + seconds
    return lambda: time.monotonic() >= moment


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("seconds", [0.3, 0.6, 0.9, 1.2, 1.5])
def test_while_it_imports_and_builds(seconds: float, number: signal.Signals, tmp_path: Path) -> None:
    """The case is large: building it takes many seconds."""
    arguments = ["train", MODELS / "paper-grid" / "rq1-4.yaml", "-o", tmp_path / "run"]
    assert interrupted(arguments, after(seconds), number) == "interrupted"
    assert list(tmp_path.iterdir()) == []


def test_while_files_of_a_folder_are_written(tmp_path: Path) -> None:
    out = tmp_path / "models"

    def writing() -> bool:
        return any(folder.is_dir() and any(folder.iterdir()) for folder in tmp_path.glob(f"{STAGING}*"))

    assert interrupted(["render", MODELS / "paper-grid" / "rq1-6.yaml", "-o", out], writing) == "interrupted"
    assert list(tmp_path.iterdir()) == []


def test_while_storm_checks(tmp_path: Path) -> None:
    report = tmp_path / "verdicts.json"
    line = interrupted(["verify", MODELS / "paper-grid" / "rq1-6.yaml", "--json", report], after(4))
    assert line == "interrupted"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("threads", ["1", "2"])
@pytest.mark.parametrize("seconds", [0.0, 1.0, 3.0])
def test_while_the_learner_compiles_and_trains(seconds: float, threads: str, tmp_path: Path) -> None:
    """With an empty cache of compiled code; the command in the line goes on, and comes to the same."""
    out = tmp_path / "my run"
    begun: list[float] = []

    def moment() -> bool:
        if not begun and (out / "manifest.json").exists():
            begun.append(time.monotonic())
        return bool(begun) and time.monotonic() - begun[0] >= seconds

    line = interrupted(
        ["train", ONE_OF_THREE, "-o", out, *LONG],
        moment,
        NUMBA_CACHE_DIR=str(tmp_path / "cache"),
        OMP_NUM_THREADS=threads,
    )
    assert line == f"interrupted; go on with: merap train -o {shlex.quote(str(out))} --resume"
    assert not any(STAGING in name for name in contents(out))
    assert not (out / "policy.safetensors").exists()


def test_training_goes_on_with_the_command_that_is_told(tmp_path: Path) -> None:
    undisturbed = trained(tmp_path / "undisturbed", SMALL.model_copy(update={"updates": 3000}))
    out = tmp_path / "run"
    words = ["--updates", "3000", "--set", "hidden=[4]", "--set", "episodes=5"]
    line = interrupted(["train", ONE_OF_THREE, "-o", out, *words], (out / "checkpoint.safetensors").exists)
    done = merap(*shlex.split(line.removeprefix("interrupted; go on with: merap ")))
    assert done.returncode == 0, done.stderr
    assert what_was_learned(out) == what_was_learned(undisturbed.path)


def test_the_loop_goes_on_with_the_command_that_is_told(tmp_path: Path) -> None:
    run, scenario, log = trained(tmp_path / "run"), tmp_path / "moved.yaml", tmp_path / "events.jsonl"
    scenario.write_text(MOVED.replace("episodes: 10", "episodes: 200"), encoding="utf-8")
    arguments = ["run", run.path, "--scenario", scenario, "--log", log, "--db", tmp_path / "k.db"]
    line = interrupted(arguments, lambda: log.exists() and log.read_text().count("episode") > 3)
    assert line == (
        f"interrupted; go on with: merap run {run.path} --scenario {scenario} --db {tmp_path / 'k.db'} "
        f"--log {log} --manager merap --resume"
    )
    done = merap(*shlex.split(line.removeprefix("interrupted; go on with: merap ")))
    assert done.returncode == 0, done.stderr
    assert "200 episodes returned" in done.stdout


def test_children_end_too(tmp_path: Path) -> None:
    """A process that was started on the way does not outlive the one that is interrupted."""
    program = (
        "import subprocess, sys, time\n"
        "from merap.cli.interruption import interruptible\n"
        "with interruptible():\n"
        "    child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "    print(child.pid, flush=True)\n"
        "    time.sleep(60)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    child = int(process.stdout.readline())
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=SOON)
    assert (process.returncode, err) == (130, "interrupted\n")
    deadline = time.monotonic() + SOON
    while is_running(child):  # it is killed, and ends when it gets its turn
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_library_that_takes_the_signal_for_itself_does_not_keep_it() -> None:
    """As Z3 does while Storm builds a model: it sets a handler in C and returns as if it were done."""
    program = (
        "import ctypes, time\n"
        "from merap.cli.interruption import interruptible\n"
        "with interruptible():\n"
        "    ctypes.CDLL(None).signal(2, ctypes.c_void_p(1))\n"
        "    print('begun', flush=True)\n"
        "    time.sleep(5)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "interrupted\n")


def test_an_interrupted_line_needs_no_reader(tmp_path: Path) -> None:
    """Nobody reads standard error any more."""
    words = command("train", MODELS / "paper-grid" / "rq1-4.yaml", "-o", tmp_path / "run")
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    assert process.stderr is not None
    process.stderr.close()
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    assert process.wait(SOON) == 130


def test_a_signal_that_the_shell_ignores_stays_ignored() -> None:
    ignoring = f"import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); {RUN_VALIDATE}"
    process = subprocess.Popen([sys.executable, "-c", ignoring], stdout=subprocess.PIPE, text=True)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=SOON)
    assert process.returncode == 0
    assert "18 combinations" in out


def test_handlers_are_as_before_when_the_command_line_has_run() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert merap("validate", RUNNING).returncode == 0
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
