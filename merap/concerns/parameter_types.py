"""The types of parameters: what values one may have, and what hypotheses about it can be made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import PlainValidator, WithJsonSchema

from merap.concerns.schema_base import is_number, is_whole, shown, wrong
from merap.errors import InputError
from merap.program.expressions import Kind, exact
from merap.program.names import IDENTIFIER, check_name, suggestion

TypeName: TypeAlias = Literal[
    "location", "locations", "edges", "doors", "probability", "int", "real", "bool", "values"
]
NUMBERS: tuple[TypeName, ...] = ("int", "real", "probability")
SPATIAL: tuple[TypeName, ...] = ("location", "locations", "edges", "doors")
BARE: tuple[TypeName, ...] = (*SPATIAL, "probability", "int", "real", "bool")
_ALLOWED = (
    f"{', '.join(BARE)}, or a mapping of int, real or probability to [least, greatest] or of values to a list"
)


@dataclass(frozen=True)
class ParameterType:
    """The type of a parameter.

    Attributes:
        name: of the type.
        bounds: least and greatest value of a number; None: it has no domain.
        values: of `values`: all names, or all numbers.
    """

    name: TypeName
    bounds: tuple[Fraction, Fraction] | None = None
    values: tuple[str | Fraction, ...] = ()

    def __str__(self) -> str:
        return self.name

    @property
    def text(self) -> str:
        """Its name and domain, such as `int 0..3`."""
        if self.bounds is not None:
            return f"{self.name} {'..'.join(map(_number_text, self.bounds))}"
        if self.values:
            return ", ".join(self.value_names or [_number_text(Fraction(value)) for value in self.values])
        return self.name

    @property
    def value_names(self) -> tuple[str, ...]:
        """The names of its values, if they have names; they are numbered from 0 on."""
        return tuple(value for value in self.values if isinstance(value, str))

    @property
    def is_set(self) -> bool:
        """Whether a value is a set, of which members can be chosen."""
        return self.name in ("locations", "edges", "doors")

    @property
    def holds_locations(self) -> bool:
        """Whether a value is a location or several."""
        return self.name in ("location", "locations")

    @property
    def kind(self) -> Kind | None:
        """What expressions read; None: they can't read it."""
        if self.name in ("edges", "doors"):
            return None
        return "locations" if self.holds_locations else "bool" if self.name == "bool" else "number"

    @property
    def is_open(self) -> bool:
        """Whether it is a number without a domain, so that only the values of the support are known."""
        return self.name in NUMBERS and self.bounds is None

    def numbers(self, limit: int) -> Sequence[Fraction | bool]:
        """Return every value of a `bool`, of whole numbers or of listed values.

        Raises:
            InputError: there are more than `limit` or infinitely many, or there is no domain.
        """
        if self.name == "bool":
            return False, True
        if self.values:
            return [
                Fraction(index) if isinstance(value, str) else value
                for index, value in enumerate(self.values)
            ]
        if self.name == "int" and self.bounds is not None:
            count = int(self.bounds[1] - self.bounds[0]) + 1
            if count > limit:
                raise InputError(f"all are {count} values, at most {limit} are allowed; list some")
            return [Fraction(value) for value in range(int(self.bounds[0]), int(self.bounds[1]) + 1)]
        domain = "a domain, as {int: [0, 3]}" if self.name == "int" else "a list of values"
        raise InputError(f"all needs {domain}: this parameter is of type {self.name}")

    def parse(self, raw: Any) -> Fraction | bool:
        """Return the canonical form of a value that is no location, edge or door.

        Raises:
            InputError: it is not in the domain.
        """
        if self.name == "bool":
            if not isinstance(raw, bool):
                raise InputError(f"expected true or false, got {shown(raw)}")
            return raw
        if self.name == "values":
            return self._listed(raw)
        if not (is_whole(raw) if self.name == "int" else is_number(raw)):
            raise InputError(f"expected a {'whole ' if self.name == 'int' else ''}number, got {shown(raw)}")
        if self.name == "probability" and not 0 <= raw <= 1:
            raise InputError(f"expected a probability in [0, 1], got {shown(raw)}")
        value = exact(raw)
        if self.bounds is not None and not self.bounds[0] <= value <= self.bounds[1]:
            low, high = (_number_text(bound) for bound in self.bounds)
            raise InputError(f"{shown(raw)} is outside the parameter's domain, {low} to {high}")
        return value

    def _listed(self, raw: Any) -> Fraction:
        names = self.value_names
        if isinstance(raw, str) and raw in names:
            return Fraction(names.index(raw))
        if not names and is_number(raw) and exact(raw) in self.values:
            return exact(raw)
        known = names or [_number_text(Fraction(value)) for value in self.values]
        raise InputError(f"{shown(raw)} is none of the parameter's values{suggestion(str(raw), known)}")

    def present(self, value: Fraction | bool) -> bool | int | float | str:
        """Return the form that a file would give a canonical value of `parse`."""
        if isinstance(value, bool):
            return value
        if self.value_names:
            return self.value_names[int(value)]
        return int(value) if self.name == "int" or (value.denominator == 1 and self.values) else float(value)


def _number_text(value: Fraction) -> str:
    return str(value.numerator) if value.denominator == 1 else f"{float(value):.10g}"


def parameter_type(given: Any) -> ParameterType:
    """Parse a type as a file gives it.

    Raises:
        PydanticCustomError: it is none.
    """
    if isinstance(given, str) and given in BARE:
        return ParameterType(given)
    if isinstance(given, Mapping) and len(given) == 1:
        ((name, domain),) = given.items()
        if name in NUMBERS:
            return ParameterType(name, bounds=_bounds(name, domain))
        if name == "values":
            return ParameterType(name, values=_values(domain))
    raise wrong(f"expected a type: {_ALLOWED}; got {shown(given)}")


def _bounds(name: TypeName, given: Any) -> tuple[Fraction, Fraction]:
    allowed = is_whole if name == "int" else is_number
    if not (
        isinstance(given, tuple) and len(given) == 2 and all(map(allowed, given)) and given[0] <= given[1]
    ):
        numbers = "whole numbers" if name == "int" else "numbers"
        raise wrong(
            f"expected [least, greatest] as {numbers} with least <= greatest, got {shown(given)}", (name,)
        )
    if name == "probability" and not (given[0] >= 0 and given[1] <= 1):
        raise wrong(f"expected probabilities in [0, 1], got {shown(given)}", (name,))
    return exact(given[0]), exact(given[1])


def _values(given: Any) -> tuple[str | Fraction, ...]:
    path = ("values",)
    if not isinstance(given, tuple) or not given:
        raise wrong(f"expected a list of values, got {shown(given)}", path)
    if len(set(given)) < len(given):
        raise wrong("a value stands twice", path)
    if all(map(is_number, given)):
        return tuple(map(exact, given))
    if not all(isinstance(value, str) for value in given):
        raise wrong(f"expected names alone or numbers alone, got {shown(given)}", path)
    for value in given:
        try:
            check_name(value, "a value")
        except InputError as error:
            raise wrong(error.message, path) from error
    return given


def _pair(of: str) -> dict[str, Any]:
    return {"type": "array", "items": {"type": of}, "minItems": 2, "maxItems": 2}


_SCHEMA = {
    "anyOf": [
        {"enum": list(BARE)},
        *(
            {
                "type": "object",
                "properties": {name: _pair("integer" if name == "int" else "number")},
                "required": [name],
                "additionalProperties": False,
                "description": "[least, greatest]",
            }
            for name in NUMBERS
        ),
        {
            "type": "object",
            "properties": {
                "values": {
                    "type": "array",
                    "minItems": 1,
                    "uniqueItems": True,
                    "items": {"anyOf": [{"type": "number"}, {"type": "string", "pattern": IDENTIFIER}]},
                }
            },
            "required": ["values"],
            "additionalProperties": False,
        },
    ]
}
Parameter = Annotated[ParameterType, PlainValidator(parameter_type), WithJsonSchema(_SCHEMA)]
