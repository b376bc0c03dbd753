"""The command line in the process of the test: the imports of another one take longer than most verbs."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import pytest

from merap.cli.main import main


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
        """The one clear line of a refusal."""
        done = self(*arguments)
        assert (done.code, done.out) == (2, ""), done
        (line,) = done.err.strip().splitlines()
        assert line.startswith("error: ")
        return line
