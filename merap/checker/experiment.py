"""Arrange the results of many values of constants: tables, and lines over one constant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import isfinite
from typing import NamedTuple

from merap.checker.checking import Result
from merap.errors import InputError


class ResultTable(NamedTuple):
    """Results of properties that depend on the same constants.

    Attributes:
        constants: those that have several values.
        rows: values of these -> name of the property -> result.
    """

    constants: tuple[str, ...]
    rows: Mapping[tuple[str, ...], Mapping[str, Result]]


def tables(results: Sequence[Result]) -> list[ResultTable]:
    """Return a table for each set of constants that properties vary with."""
    varying = _varying(results)
    found: dict[tuple[str, ...], dict[tuple[str, ...], dict[str, Result]]] = {}
    for result in results:
        names = tuple(name for name in result.constants if name in varying)
        row = tuple(result.constants[name] for name in names)
        found.setdefault(names, {}).setdefault(row, {})[result.name] = result
    return [ResultTable(names, rows) for names, rows in found.items()]


def lines(results: Sequence[Result]) -> tuple[str, dict[str, list[tuple[float, float]]]]:
    """Return the constant with most values, and for each property and choice of the others its points.

    Raises:
        InputError: no number has several values.
    """
    counts = {name: len(values) for name, values in _varying(results).items() if "true" not in values}
    if not counts:
        raise InputError("a plot needs a constant with several values, as --const n=1:10")
    constant = max(counts, key=lambda name: counts[name])
    found: dict[str, list[tuple[float, float]]] = {}
    for result in results:
        if constant not in result.constants or result.value is None or not isfinite(result.value):
            continue
        rest = {name: value for name, value in result.constants.items() if name in counts.keys() - {constant}}
        others = [f"{name}={value}" for name, value in rest.items()]
        name = ", ".join([result.name, *others])
        point = float(Fraction(result.constants[constant])), result.value
        found.setdefault(name, []).append(point)
    return constant, found


def _varying(results: Sequence[Result]) -> dict[str, set[str]]:
    values: dict[str, set[str]] = {}
    for result in results:
        for name, value in result.constants.items():
            values.setdefault(name, set()).add(value)
    return {name: several for name, several in values.items() if len(several) > 1}
