"""Where the system is, in expressions: `at(..)`, and membership in sets that parameters hold."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from merap.errors import InputError
from merap.program.expressions import (
    Column,
    Constant,
    Kind,
    Lookup,
    Operation,
    Table,
    Variable,
    check,
    fold,
    parse,
    render,
    variables,
)


@pytest.mark.parametrize(
    ("text", "operator", "places"),
    [
        ("at(hall)", "at", ["hall"]),
        ("at ( hall )", "at", ["hall"]),
        ("at'(target)", "at'", ["target"]),
        ("at([hall, ward])", "at", ["hall", "ward"]),
        ("at([3, 4])", "at", ["cell(3, 4)"]),
        ("at([[3, 4], ward, [0, 5]])", "at", ["cell(3, 4)", "ward", "cell(0, 5)"]),
    ],
)
def test_locations_are_names_or_cells(text: str, operator: str, places: list[str]) -> None:
    found = parse(text)
    assert isinstance(found, Operation)
    assert found.operator == operator
    assert list(map(render, found.arguments)) == places


def test_at_without_parentheses_is_a_name() -> None:
    assert parse("at + at'") == Operation("+", (Variable("at", 1), Variable("at'", 6)))


@pytest.mark.parametrize("text", ["at()", "at([])", "at(1)", "at([1, 2, 3])", "at(x + 1)", "at(a, b)"])
def test_what_is_no_location_is_a_syntax_error(text: str) -> None:
    with pytest.raises(InputError, match="syntax error at column"):
        parse(text)


def test_a_set_is_put_in_as_the_table_of_its_members() -> None:
    inside = Operation("in", (Variable("x", 1), Variable("some", 1)))
    kinds: dict[str, Kind] = {"x": "number", "some": "locations"}
    check(inside, kinds, "bool")
    members = Table("", Column.of(np.array([True, False, True])))
    assert fold(inside, {}) == inside
    assert fold(inside, {"some": members}) == Lookup(members, Variable("x", 1))
    assert fold(inside, {"some": members, "x": Fraction(1)}) == Constant(False)
    # 1 / y is put off where it may not be needed; the set is known there too
    late = Operation("&", (Variable("y", 1), Operation("=", (parse("1 / 0"), parse("2")))))
    both = Operation("&", (Variable("y", 1), Operation("&", (inside, late))))
    found = fold(both, {"some": members})
    assert [variable.name for variable in variables(found)] == ["y", "x", "y"]


@pytest.mark.parametrize("wrong", ["some + 1", "some", "some = 2", "some & true"])
def test_a_set_is_no_number(wrong: str) -> None:
    with pytest.raises(InputError):
        check(parse(wrong), {"some": "locations"}, "number")
