"""Read PRISM text into a program, in a process of its own, so that a crash of Storm's parser is one line.

Text that Storm reads wrongly without a word, or crashes on, is found before and refused by name.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

from merap.checker.prism_scan import readable_text
from merap.errors import EngineError, InputError
from merap.program.form import Program

SECONDS = 120


def read_prism(path: Path) -> Program:
    """Read a PRISM MDP; constants that it leaves open, and PAYNT's holes, are the program's parameters.

    Args:
        path: path of the file.

    Raises:
        InputError: it can't be read, or uses something that is not supported; names file and line.
        EngineError: Storm crashed on it, or took longer than two minutes.
    """
    try:
        text = readable_text(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"can't be read: {error}", source=str(path)) from error
    except InputError as error:
        raise InputError(error.message, source=str(path), line=error.line) from error
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "model.prism", Path(folder) / "program"
        given.write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "merap.checker.prism_parsing", str(given), str(found)]
        try:
            done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
        except subprocess.TimeoutExpired as error:
            raise EngineError(f"{path}: Storm's parser took longer than {SECONDS} s") from error
        if done.returncode or not found.exists():
            raise EngineError(f"{path}: Storm's parser crashed (exit code {done.returncode})")
        result = pickle.loads(found.read_bytes())
    if isinstance(result, Program):
        return result
    message, line = result
    raise InputError(message, source=str(path), line=line)
