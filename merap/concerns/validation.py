"""Check a document against the schema; pydantic's errors become one clear line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from merap.concerns.document import Document, KeyPath, existing_path
from merap.concerns.schema_base import Spec, shown
from merap.errors import InputError

Specified = TypeVar("Specified", bound=Spec)

# pydantic's kind of error: what is allowed, with the values of its context.
_EXPECTED: Mapping[str, str] = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_parsing": "a number",
    "bool_parsing": "true or false",
    "float_type": "a number",
    "string_type": "text",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "greater_than": "a number above {gt}",
    "greater_than_equal": "a number of at least {ge}",
    "less_than": "a number below {lt}",
    "finite_number": "a finite number",
    "less_than_equal": "a number of at most {le}",
    "literal_error": "{expected}",
}


def validate(document: Document, schema: type[Specified]) -> Specified:
    """The schema's view of `document`.

    Raises:
        InputError: names the first offence in the file, and how many more there are.
    """
    try:
        return schema.model_validate(document.data)
    except ValidationError as error:
        raise _first(document, error) from error


def _first(document: Document, error: ValidationError) -> InputError:
    found = [(_path(document.data, details), details) for details in error.errors(include_url=False)]
    path, details = min(found, key=lambda item: document.line_of(item[0]))
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return document.error(path, message(details) + more)


def _path(data: Any, details: ErrorDetails) -> KeyPath:
    """The error's place without the tags of unions, which stand in angle brackets."""
    parts = tuple(part for part in details["loc"] if not str(part).startswith("<"))
    inner: KeyPath = details.get("ctx", {}).get("path", ())
    return existing_path(data, (*parts, *inner))


def message(details: ErrorDetails) -> str:
    """Say in plain words what is allowed for a value, and what was given."""
    kind = details["type"]
    if kind == "missing":
        key = details["loc"][-1]
        too_few = f"too few entries, got {shown(details['input'])}"
        return f"key {key!r} is missing" if isinstance(key, str) else too_few
    if kind == "merap":
        return _with_value(details)
    if kind in _EXPECTED:
        expected = _EXPECTED[kind].format(**details.get("ctx", {}))
        return f"expected {expected}, got {shown(details['input'])}"
    return f"{details['msg']}, got {shown(details['input'])}"


def _with_value(details: ErrorDetails) -> str:
    """Own messages name the value already, except those of a `Discriminator`, which can't."""
    if "path" in details.get("ctx", {}):
        return details["msg"]
    return f"{details['msg']}, got {shown(details['input'])}"
