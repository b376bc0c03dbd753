"""Building blocks of the case file's schema: strict models and the forms of values.

Sequences arrive as tuples. Where a value has several forms, one validator brings it into one
form, so that an error names the form that is missing instead of one error for each form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainValidator, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from merap.concerns.document import KeyPath
from merap.masking import masked_url
from merap.mdp.short_repr import ShortRepr
from merap.program.names import IDENTIFIER, suggestion


class Spec(BaseModel):
    """A mapping of the case file: frozen, no unknown keys, no conversions, no infinities."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    def __repr__(self) -> str:
        return f"{type(self).__name__}(keys {', '.join(sorted(self.model_fields_set))})"

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        if not isinstance(data, Mapping):
            raise wrong(f"expected a mapping with keys of {', '.join(known)}; got {shown(data)}")
        for key in data:
            if key not in known:
                raise wrong(f"unknown key {key!r}{suggestion(key, known)}", (key,))
        return data


def wrong(message: str, path: KeyPath = ()) -> PydanticCustomError:
    """An error for a validator to raise; `path` leads from the validated value to the wrong part."""
    text = message.replace("{", "(").replace("}", ")")
    return PydanticCustomError("merap", text, {"path": path})


def shown(value: Any) -> str:
    """A value of the file for messages, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        text = "a mapping" + (f" with the keys {', '.join(map(str, value))}" if value else " without keys")
    elif isinstance(value, tuple):
        text = "[" + ", ".join(shown(part) for part in value[:6]) + (", ..." if len(value) > 6 else "") + "]"
    else:
        # Before it is shortened: a URL that is cut can't be recognised.
        text = repr(masked_url(value) if isinstance(value, str) else value)
    return text if len(text) <= 80 else f"{text[:77]}..."


LocationRef: TypeAlias = str | tuple[int, int]


@dataclass(frozen=True)
class Box:
    """The cells of a grid from row to row and from column to column, ends included."""

    rows: tuple[int, int]
    cols: tuple[int, int]


LocationSet: TypeAlias = Box | tuple[LocationRef, ...]


def is_whole(value: Any) -> bool:
    """Return whether `value` is an integer, and not `true` or `false`."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Return whether `value` is a number, and not `true` or `false`."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_cell(value: Any) -> bool:
    """Return whether `value` is `[row, col]`."""
    return isinstance(value, tuple) and len(value) == 2 and all(map(is_whole, value))


def location_ref(value: Any, *, path: KeyPath = ()) -> LocationRef:
    """A name or `[row, col]`, which stands at `path`."""
    if isinstance(value, str):
        return value
    if is_cell(value):
        return (value[0], value[1])
    raise wrong(f"expected a location: a name, or [row, col] on a grid; got {shown(value)}", path)


def location_set(value: Any, *, path: KeyPath = ()) -> LocationSet:
    """One location, a list of them, or a box `{rows: [a, b], cols: [c, d]}`, which stands at `path`."""
    if isinstance(value, str) or is_cell(value):
        return (location_ref(value),)
    if isinstance(value, tuple):
        return tuple(location_ref(entry, path=(*path, index)) for index, entry in enumerate(value))
    if isinstance(value, Mapping) and set(value) == {"rows", "cols"}:
        return Box(_bounds(value, "rows", path), _bounds(value, "cols", path))
    raise wrong(
        "expected a location, a list of locations, or a box with rows: [a, b] and cols: [c, d] on a grid; "
        f"got {shown(value)}",
        path,
    )


def _bounds(box: Mapping[str, Any], key: str, path: KeyPath) -> tuple[int, int]:
    value = box[key]
    if not is_cell(value) or value[0] > value[1]:
        raise wrong(
            f"expected [first, last] as whole numbers with first <= last, got {shown(value)}", (*path, key)
        )
    return (value[0], value[1])


def _number_or_text(value: Any) -> int | float | str:
    if is_number(value) or isinstance(value, str):
        return value  # type: ignore[no-any-return]
    raise wrong(f"expected a number or an expression in quotes, got {shown(value)}")


def _truth_or_text(value: Any) -> bool | str:
    if isinstance(value, bool | str):
        return value
    raise wrong(f"expected true, false or an expression in quotes, got {shown(value)}")


def _name_list(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


_CELL_SCHEMA = {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2}
REF_SCHEMA = {"anyOf": [{"type": "string"}, _CELL_SCHEMA]}
SET_SCHEMA = {
    "anyOf": [
        {"type": "string", "description": "a location, or a parameter that holds locations"},
        {"type": "array", "items": REF_SCHEMA, "description": "several, or one as [row, col]"},
        _CELL_SCHEMA,
        {
            "type": "object",
            "properties": {"rows": _CELL_SCHEMA, "cols": _CELL_SCHEMA},
            "required": ["rows", "cols"],
            "additionalProperties": False,
            "description": "the cells of a grid from row to row and column to column, ends included",
        },
    ]
}

Name = Annotated[str, WithJsonSchema({"type": "string", "pattern": IDENTIFIER})]
Locations = Annotated[LocationSet, PlainValidator(location_set), WithJsonSchema(SET_SCHEMA)]
Number = Annotated[
    int | float | str,
    PlainValidator(_number_or_text),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "description": "an expression"}]}),
]
Truth = Annotated[
    bool | str,
    PlainValidator(_truth_or_text),
    WithJsonSchema({"anyOf": [{"type": "boolean"}, {"type": "string", "description": "an expression"}]}),
]
Names = Annotated[
    tuple[str, ...],
    BeforeValidator(_name_list, json_schema_input_type=str | tuple[str, ...]),
]


@dataclass(frozen=True, repr=False)
class Setting(ShortRepr):
    """A value for some locations, and where it stands below its key."""

    at: LocationSet
    value: Any
    path: KeyPath


def _settings(value: Any) -> tuple[Setting, ...]:
    if isinstance(value, Mapping):
        return tuple(Setting((name,), entry, (name,)) for name, entry in value.items())
    if isinstance(value, tuple):
        return tuple(_setting(entry, index) for index, entry in enumerate(value))
    raise wrong(
        "expected a mapping of locations to values, or a list of entries with at and value; "
        f"got {shown(value)}"
    )


def _setting(entry: Any, index: int) -> Setting:
    if not isinstance(entry, Mapping) or set(entry) != {"at", "value"}:
        raise wrong(f"expected a mapping with the keys at and value, got {shown(entry)}", (index,))
    return Setting(location_set(entry["at"], path=(index, "at")), entry["value"], (index,))


_VALUE_SCHEMA: dict[str, Any] = {"type": ["number", "boolean", "string"]}
Settings = Annotated[
    tuple[Setting, ...],
    PlainValidator(_settings),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "object", "additionalProperties": _VALUE_SCHEMA},
                {
                    "type": "array",
                    "items": {
                        "type": "object",
                        "properties": {"at": SET_SCHEMA, "value": _VALUE_SCHEMA},
                        "required": ["at", "value"],
                        "additionalProperties": False,
                    },
                },
            ]
        }
    ),
]
