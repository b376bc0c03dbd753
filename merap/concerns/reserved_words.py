"""The words of the case language, and the names that belong to every model."""

from __future__ import annotations

from merap.concerns.location_words import WORDS as LOCATION_WORDS
from merap.concerns.schema_capability import STAY
from merap.concerns.schema_processes import ANY
from merap.errors import InputError
from merap.mdp.reserved_names import (
    COMPLETE_LABEL,
    END_ACTION,
    FLAG_VARIABLE,
    GOAL_LABEL,
    MODE_VARIABLE,
    UNSAFE_LABEL,
)
from merap.program.expressions import ARITIES
from merap.program.names import check_name

SYNTAX = frozenset({MODE_VARIABLE, "true", "false", "log", *ARITIES})
WORDS = SYNTAX | {*LOCATION_WORDS, "at", ANY, STAY, END_ACTION}
# Variables and processes that every model has.
_OWN = frozenset({FLAG_VARIABLE, "loc", "space", "capability", "objective"})
_LABELS = frozenset({COMPLETE_LABEL, GOAL_LABEL, UNSAFE_LABEL, "init", "deadlock", "out_of_bounds"})


def check_readable_name(name: str, what: str) -> None:
    """Refuse a name that expressions can't read.

    Raises:
        InputError: it is no identifier, or belongs to the syntax of expressions.
    """
    check_name(name, what)
    if name in SYNTAX:
        raise InputError(f"illegal name {name!r} of {what}: expressions use it")


def check_variable_name(name: str, what: str) -> None:
    """Refuse a name of a process or a variable that means something else already.

    Raises:
        InputError: it is no identifier, a word of the language or one of every model's own names.
    """
    check_name(name, what)
    if name in WORDS:
        raise InputError(f"illegal name {name!r} of {what}: it is a word of the case language")
    if name in _OWN:
        raise InputError(f"illegal name {name!r} of {what}: every model has one of that name")


def check_action_name(name: str, what: str) -> None:
    """Refuse a name that no action can have.

    Raises:
        InputError: it is no identifier, or `end`.
    """
    check_name(name, what)
    if name == END_ACTION:
        raise InputError(f"illegal name {name!r} of {what}: it is the action of complete states")


def check_label_name(name: str) -> None:
    """Refuse a name that no declared label can have.

    Raises:
        InputError: it is no identifier, or a label that models have by themselves.
    """
    check_name(name, "a label")
    if name in _LABELS:
        raise InputError(f"illegal name {name!r} of a label: every model has one of that name")
