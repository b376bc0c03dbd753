"""What can go wrong with a system that is managed from outside."""

from __future__ import annotations

from typing import ClassVar, Literal

from merap.errors import MerapError

# timeout: no answer in time; refused: no connection; dropped: the connection broke amid an answer;
# malformed: the answer is not what the schema says; failed: the system reports a fault of its own;
# rejected: it refuses the request; missed: it has gone on by itself, or someone else manages it too;
# gone: no episode could begin, several times in a row.
FaultKind = Literal["timeout", "refused", "dropped", "malformed", "failed", "rejected", "missed", "gone"]


class SystemFault(MerapError):  # noqa: N818 (what happens to a system is a fault; errors are ours)
    """A managed system can't be reached or doesn't behave; `str(error)` is one clear line.

    Args:
        kind: see `FaultKind`.
        message: what happened, and with what.
        repeatable: the same call may be made again and does not act twice.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, kind: FaultKind, message: str, *, repeatable: bool = True) -> None:
        self.kind = kind
        self.message = " ".join(message.split())
        self.repeatable = repeatable
        super().__init__(f"{kind}: {self.message}")
