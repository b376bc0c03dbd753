"""Translate Storm's error messages into errors of one line that name the place."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from merap.errors import EngineError, InputError, MerapError
from merap.program.names import suggestion

# Storm puts the name of its exception before the message; these speak of what the user wrote.
_USER_ERRORS = ("WrongFormat", "Invalid", "Illegal")
_UNSUPPORTED = ("NotSupported", "NotImplemented")
_LIMITS = re.compile(r"can only be (?:computed|done) for|needs to have \(a single\) upper step bound")
_SYNTAX_ERROR = re.compile(r"Parsing error at (\d+):(\d+): ?(.*)")
_TYPE_ERROR = re.compile(r"Error in .*, line (\d+): (.*)")
_UNKNOWN = re.compile(r"(?:unknown )?(label|reward model) '(.*)'(?: does not exist)?$")


class UnsupportedPropertyError(EngineError):
    """The engine can't answer this kind of property."""


def translate(
    raised: str, place: str, user_error: type[MerapError], known: Mapping[str, Sequence[str]] | None
) -> MerapError:
    """Return the error to raise in place of Storm's.

    Args:
        raised: Storm's text, as `WrongFormatException: Parsing error at 6:1:  expecting ...`.
        place: the model or, if `known` is given, the model and its property.
        user_error: the kind where it is the text of the model or property that is wrong.
        known: names that a property may use: `label` and `reward model`.
    """
    name, _, message = raised.partition(": ")
    message = " ".join((message or name).split()).removesuffix("^").rstrip(" .")
    if syntax := _SYNTAX_ERROR.match(message):
        line, column, rest = syntax.groups()
        if known is None:
            return InputError(f"column {column}: {rest}", source=place, line=int(line))
        return InputError(f"syntax error: {rest}", source=place)  # Storm's column is not the text's
    if wrong_type := _TYPE_ERROR.match(message):
        return InputError(wrong_type[2], source=place, line=int(wrong_type[1]))
    if name.startswith(_UNSUPPORTED) or _LIMITS.search(message):
        return UnsupportedPropertyError(f"{place}: {message}")
    if known is not None and (unknown := _UNKNOWN.search(message)):
        return InputError(f"{place}: {message}{suggestion(unknown[2], known[unknown[1]])}")
    return (user_error if name.startswith(_USER_ERRORS) else EngineError)(f"{place}: {message}")
