"""The command line in the process of the test: the imports of another one take longer than most verbs."""

from __future__ import annotations

import io
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest.mock import patch

import pytest

from merap.cli.main import main


def command(*arguments: object) -> list[str]:
    """What starts `merap` in a process of its own, for what is killed or serves."""
    return [sys.executable, "-m", "merap", *map(str, arguments)]


def merap(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Call `merap`; return what `subprocess.run` reports."""
    words = ["merap", *map(str, arguments)]
    out, err = io.StringIO(), io.StringIO()
    with (
        patch.object(sys, "argv", words),
        redirect_stdout(out),
        redirect_stderr(err),
        warnings.catch_warnings(),  # main ignores all of them
        pytest.raises(SystemExit) as ended,
    ):
        main()
    return subprocess.CompletedProcess(words, int(ended.value.code or 0), out.getvalue(), err.getvalue())


def refused(*arguments: object) -> str:
    """Return the one clear line of a refusal."""
    done = merap(*arguments)
    assert (done.returncode, done.stdout) == (2, ""), done
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error: ")
    return line


@dataclass(frozen=True)
class Done:
    """What a call has come to."""

    code: int
    out: str
    err: str


class CommandLine:
    """Calls `merap` with some words in front."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
    ) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys
        self._words = words

    def __call__(self, *arguments: object) -> Done:
        self._monkeypatch.setattr(sys, "argv", ["merap", *self._words, *map(str, arguments)])
        self._capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = self._capsys.readouterr()
        return Done(int(ended.value.code or 0), printed.out, printed.err)

    def printed(self, *arguments: object) -> str:
        """What a call that succeeds prints."""
        done = self(*arguments)
        assert done.code == 0, done
        return done.out

    def refused(self, *arguments: object) -> str:
        """Return the one clear line of a refusal."""
        done = self(*arguments)
        assert (done.code, done.out) == (2, ""), done
        (line,) = done.err.strip().splitlines()
        assert line.startswith("error: ")
        return line
