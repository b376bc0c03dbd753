"""Read values for open constants, one or several each, as PRISM's experiments take them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import TypeAlias

from merap.checker.prism_model import ConstantType
from merap.errors import InputError
from merap.program.names import suggestion

MOST = 10_000
Value: TypeAlias = Fraction | bool
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?(/\d+)?")


def read_constants(given: Iterable[str]) -> dict[str, tuple[Value, ...]]:
    """Read texts such as `n=3`, `n=1:10` (low:high), `p=0.1:0.2:0.9` (low:step:high), `a=1,b=true,false`.

    Raises:
        InputError: a text is none of these, or a name is given twice.
    """
    found: dict[str, list[Value]] = {}
    for text in given:
        current: list[Value] | None = None
        for part in text.split(","):
            name, equals, values = part.rpartition("=")
            if equals:
                if name.strip() in found:
                    raise InputError(f"constant {name.strip()!r} is given twice", source="--const")
                current = found.setdefault(name.strip(), [])
            if current is None:
                raise InputError(f"{text!r}: expected name=value, as n=3 or n=1:10", source="--const")
            current += _values(values.strip(), text)
    return {name: tuple(values) for name, values in found.items()}


def _values(text: str, whole: str) -> list[Value]:
    numbers = [_value(part.strip(), whole) for part in text.split(":")]
    if len(numbers) == 1:
        return numbers
    if any(isinstance(number, bool) for number in numbers) or len(numbers) > 3:
        raise InputError(f"{whole!r}: a range is low:high or low:step:high, of numbers", source="--const")
    low, step, high = (numbers[0], Fraction(1), numbers[1]) if len(numbers) == 2 else map(Fraction, numbers)
    if step <= 0 or high < low:
        raise InputError(f"{whole!r}: expected low <= high and a step above 0", source="--const")
    if (high - low) / step >= MOST:
        raise InputError(f"{whole!r}: more than {MOST} values", source="--const")
    return [low + place * step for place in range(int((high - low) / step) + 1)]


def _value(text: str, whole: str) -> Value:
    if text in ("true", "false"):
        return text == "true"
    if not _NUMBER.fullmatch(text) or re.search(r"/0+$", text):
        raise InputError(f"{whole!r}: {text!r} is neither a number nor true or false", source="--const")
    return Fraction(text)


def shown(value: Value) -> str:
    """Return a value as text: `3`, `0.1`, `1/3`, `true`."""
    if isinstance(value, bool):
        return str(value).lower()
    short = f"{float(value):.15g}"
    return short if Fraction(short) == value and "e" not in short else str(value)


def combinations(
    given: Mapping[str, Sequence[Value]], declared: Mapping[str, ConstantType | None], source: str
) -> Iterator[dict[str, Value]]:
    """Yield every combination of values of the open constants.

    Args:
        given: constant -> its values; of other constants too.
        declared: the open constants and their types, None where the text states none.
        source: the file that declares them, for messages.

    Raises:
        InputError: one has no value, or one of another type.
    """
    for name, kind in declared.items():
        if name not in given:
            raise InputError(f"constant {name!r} has no value; give one by --const {name}=..", source=source)
        for value in given[name]:
            _require_type(name, value, kind)
    for values in product(*(given[name] for name in declared)):
        yield dict(zip(declared, values, strict=True))


def _require_type(name: str, value: Value, kind: ConstantType | None) -> None:
    is_bool = isinstance(value, bool)
    if is_bool != (kind == "bool") or (kind in ("int", None) and Fraction(value).denominator != 1):
        raise InputError(f"{name}={shown(value)}: the constant is of type {kind or 'int'}", source="--const")


def require_known(given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse values for constants that nobody declares."""
    names = list(known)
    for name in given:
        if name not in names:
            raise InputError(
                f"no open constant is called {name!r}{suggestion(name, names)}", source="--const"
            )
