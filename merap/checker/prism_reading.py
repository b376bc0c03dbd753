"""Read PRISM text into a program, in a process of its own, so that a crash of Storm's parser is one line.

Text that Storm reads wrongly without a word, or crashes on, is found before and refused by name.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

from merap.checker.prism_model import PrismModel
from merap.checker.prism_scan import readable_text
from merap.errors import EngineError, InputError

SECONDS = 120


def read_prism(path: Path) -> PrismModel:
    """Read the file of a PRISM MDP.

    Raises:
        InputError: it can't be read, or uses something that is not supported; names file and line.
        EngineError: Storm crashed on it, or took longer than two minutes.
    """
    return read_prism_text(prism_file(path), path.stem, str(path))


def prism_file(path: Path) -> str:
    """Return the text of a file.

    Raises:
        InputError: it can't be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = (error.strerror or error) if isinstance(error, OSError) else "is not UTF-8"
        raise InputError(f"can't be read: {why}", source=str(path)) from error


def read_prism_text(text: str, name: str, source: str) -> PrismModel:
    """Read the text of a PRISM MDP.

    Args:
        text: of the whole model.
        name: of the program.
        source: where the text stands, for messages.

    Raises:
        InputError: it uses something that is not supported, or is wrong; names source and line.
        EngineError: Storm crashed on it, or took longer than two minutes.
    """
    try:
        text = readable_text(text)
    except InputError as error:
        raise InputError(error.message, source=source, line=error.line) from error
    with tempfile.TemporaryDirectory(prefix="merap-") as folder:
        given, found = Path(folder) / "model.prism", Path(folder) / "program"
        given.write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "merap.checker.prism_parsing", str(given), str(found), name]
        try:
            done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
        except subprocess.TimeoutExpired as error:
            raise EngineError(f"{source}: Storm's parser took longer than {SECONDS} s") from error
        if done.returncode or not found.exists():
            raise EngineError(f"{source}: Storm's parser crashed (exit code {done.returncode})")
        result = pickle.loads(found.read_bytes())
    if isinstance(result, PrismModel):
        return result
    message, line = result
    raise InputError(message, source=source, line=line)
