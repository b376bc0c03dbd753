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
    """`name : domain init initial;`, after comments that number its values; no `init` where it is empty."""

    name: str
    domain: str
    initial: str
    key: tuple[str, ...]


@dataclass(frozen=True)
class CommandLine:
    """`[action] guard -> updates;`."""

    action: str
    guard: str
    updates: str


@dataclass(frozen=True)
class LabelLine:
    """`label "name" = text;`."""

    name: str
    text: str
