"""The kinds of lines that templates put together."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Formula:
    """`formula name = text;`, after a comment that says what it means, if there is one."""

    name: str
    text: str
    meaning: str = ""


@dataclass(frozen=True)
class VariableLine:
    """`name : [0..high] init initial;`; no `init` where `initial` is None."""

    name: str
    high: int
    initial: int | None


@dataclass(frozen=True)
class Command:
    """`[action] guard -> updates;`."""

    action: str
    guard: str
    updates: str


@dataclass(frozen=True)
class Payment:
    """`[action] guard : text;`."""

    action: str
    text: str
