"""What both ends of an HTTP connection hold to."""

from __future__ import annotations

import json
from typing import Any

MAX_PORT = 65_535


def strict_json(body: bytes | bytearray) -> Any:
    """Read JSON without the numbers that only Python's reader allows, such as NaN.

    Raises:
        ValueError, RecursionError: it is none.
    """
    return json.loads(body, parse_constant=_refuse)


def _refuse(text: str) -> object:
    raise ValueError(f"{text} is no number")
