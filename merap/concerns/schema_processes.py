"""Schema of processes: variables that change with every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema, model_validator

from merap.concerns.document import KeyPath
from merap.concerns.schema_base import Name, Names, Spec, Truth, is_number, shown, wrong
from merap.mdp.short_repr import ShortRepr

ANY = "any"
Expr = int | float | bool | str


@dataclass(frozen=True, repr=False)
class Draw(ShortRepr):
    """One thing that can happen, and where it stands below its key.

    Attributes:
        values: of the only variable, or by name.
        probability: None: what the others leave over.
        path: to the entry.
        key: of the values in it; None: the entry is the value.
    """

    values: Expr | Mapping[str, Expr]
    probability: int | float | str | None
    path: KeyPath
    key: str | None


def _draws(given: Any) -> tuple[Draw, ...]:
    if not isinstance(given, tuple):
        return (Draw(_values(given, ()), 1, (), None),)
    draws = tuple(_draw(entry, index) for index, entry in enumerate(given))
    if sum(draw.probability is None for draw in draws) > 1:
        raise wrong("otherwise stands twice")
    if not draws:
        raise wrong("expected at least one outcome")
    return draws


def _draw(entry: Any, index: int) -> Draw:
    if isinstance(entry, Mapping) and set(entry) == {"otherwise"}:
        return Draw(_values(entry["otherwise"], (index, "otherwise")), None, (index,), "otherwise")
    if not isinstance(entry, Mapping) or set(entry) != {"value", "probability"}:
        raise wrong(f"expected the keys value and probability, or otherwise; got {shown(entry)}", (index,))
    probability = entry["probability"]
    if not (is_number(probability) or isinstance(probability, str)):
        raise wrong(
            f"expected a number or an expression in quotes, got {shown(probability)}", (index, "probability")
        )
    return Draw(_values(entry["value"], (index, "value")), probability, (index,), "value")


def _values(given: Any, path: KeyPath) -> Expr | Mapping[str, Expr]:
    if isinstance(given, Mapping):
        for name, value in given.items():
            if not isinstance(value, int | float | str):
                raise wrong(f"expected a value or an expression, got {shown(value)}", (*path, name))
        return given
    if not isinstance(given, int | float | str):
        raise wrong(f"expected a value, an expression, a mapping or outcomes; got {shown(given)}", path)
    return given


_VALUE = {"type": ["number", "boolean", "string"]}
_VALUES = {"anyOf": [_VALUE, {"type": "object", "additionalProperties": _VALUE}]}
_OUTCOME = {
    "type": "object",
    "properties": {"value": _VALUES, "probability": {"type": ["number", "string"]}, "otherwise": _VALUES},
    "additionalProperties": False,
}
ALWAYS = (Draw(True, 1, (), None),)
Draws = Annotated[
    tuple[Draw, ...],
    PlainValidator(_draws),
    WithJsonSchema({"anyOf": [*_VALUES["anyOf"], {"type": "array", "items": _OUTCOME, "minItems": 1}]}),
]


class VariableSpec(Spec):
    """A variable: give `range`, `type: bool` or `values`."""

    range: tuple[int, int] | None = Field(default=None, description="whole numbers: [least, greatest]")
    type: Literal["bool"] | None = Field(default=None, description="bool: true or false")
    values: tuple[Name, ...] | None = Field(default=None, min_length=1, description="names of its values")
    initial: Draws | None = Field(default=None, description="a value, an expression or outcomes")

    @model_validator(mode="after")
    def _one_domain(self) -> VariableSpec:
        given = [key for key in ("range", "type", "values") if getattr(self, key) is not None]
        if len(given) != 1 and not getattr(self, "variables", None):
            raise wrong(f"give exactly one of range, type and values, not {' and '.join(given) or 'none'}")
        if self.range is not None and self.range[0] > self.range[1]:
            raise wrong(f"expected [least, greatest], got {shown(self.range)}", ("range",))
        return self


class SetSpec(Spec):
    """What becomes of a process where a condition holds."""

    where: Truth = Field(default=True, description="a condition on the state before the step")
    set: Draws = Field(description="what the variables become: an expression, a mapping or outcomes")


class ProcessChangeSpec(SetSpec):
    """A change; the first that matches a step counts, without a match nothing changes."""

    action: Names | None = Field(default=None, description="an action or several; left out or `any`: all")


def _change(value: Any) -> Any:
    return value if isinstance(value, Mapping) and "set" in value else {"set": value}


Sets = dict[Name, Annotated[SetSpec, BeforeValidator(_change, json_schema_input_type=SetSpec | Draws)]]


class ProcessSpec(VariableSpec):
    """One variable that is called as the process, or several under `variables`."""

    variables: dict[Name, VariableSpec] = Field(default={}, description="name: a variable")
    changes: tuple[ProcessChangeSpec, ...] = Field(default=(), description="rules of change, in order")

    @model_validator(mode="after")
    def _one_form(self) -> ProcessSpec:
        for key in ("range", "type", "values"):
            if self.variables and getattr(self, key) is not None:
                raise wrong(f"{key} goes with a process of one variable, not beside variables", (key,))
        own = [name for name, one in self.variables.items() if one.initial is not None]
        if self.initial is not None and own:
            raise wrong("give initial to the process or to its variables, not to both", ("initial",))
        missing = [name for name, one in self.variables.items() if one.initial is None]
        if self.initial is None and (missing or not self.variables):
            raise wrong(f"missing key 'initial'{f' of {missing[0]}' if missing else ''}")
        return self
