"""Tables that expressions read."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from merap.errors import InputError
from merap.program.expressions import (
    Column,
    Constant,
    Levels,
    Lookup,
    Table,
    Variable,
    check,
    evaluate,
    evaluate_where_defined,
    evaluate_whole,
    fold,
    parse,
    render,
    substitute,
    tabulate,
    variables,
)

PRICE = Table("price", Column.of(np.array([0.1, 0.2, 0.1, 3.0])))
OPEN = Table("open", Column.of(np.array([True, False, True, True])))
THERE = Table("there", Column.of(np.array([1, 3, 0, 2])))
X = Variable("x", 0)
PLACES = {"x": np.arange(4)}


def test_a_lookup_reads_the_exact_value() -> None:
    assert fold(Lookup(PRICE, X), {"x": Fraction(1)}) == Constant(Fraction(1, 5))
    assert fold(Lookup(OPEN, X), {"x": Fraction(1)}) == Constant(False)
    values, codes = tabulate(Lookup(PRICE, X), PLACES)
    assert [values[code] for code in codes] == [Fraction(1, 10), Fraction(1, 5), Fraction(1, 10), 3]
    assert evaluate(Lookup(PRICE, X), PLACES).tolist() == [0.1, 0.2, 0.1, 3]
    assert evaluate(Lookup(OPEN, X), PLACES).tolist() == [True, False, True, True]


def test_lookups_nest() -> None:
    assert evaluate(Lookup(PRICE, Lookup(THERE, X)), PLACES).tolist() == [0.2, 3, 0.1, 0.1]


@pytest.mark.parametrize("index", ["x - 1", "2 * x", "x / 2"])
def test_a_number_that_the_table_does_not_have_is_undefined(index: str) -> None:
    places = [Fraction(value) for value in range(4)]
    numbers = [fold(parse(index), {"x": place}) for place in places]
    fits = [
        isinstance(one, Constant) and one.value.denominator == 1 and 0 <= one.value < 4 for one in numbers
    ]
    _, defined = evaluate_where_defined(Lookup(OPEN, parse(index)), PLACES)
    assert defined.tolist() == fits
    _, whole = evaluate_whole(Lookup(THERE, parse(index)), PLACES)
    assert whole.tolist() == fits
    with pytest.raises(InputError, match="price has no value at"):
        evaluate(Lookup(PRICE, parse(index)), PLACES)


def test_numbers_beyond_64_bits_are_read_too() -> None:
    huge = Fraction(10**30)
    table = Table("huge", Column(Levels((huge, Fraction(1))), np.array([0, 1])))
    values, codes = tabulate(Lookup(table, X), {"x": np.array([0, 1, 0])})
    assert [values[code] for code in codes] == [huge, 1, huge]


def test_a_lookup_is_an_expression_like_others() -> None:
    lookup = Lookup(PRICE, parse("x + y"))
    assert [variable.name for variable in variables(lookup)] == ["x", "y"]
    assert render(substitute(lookup, {"y": parse("2 * z")})) == "price[x + 2 * z]"
    check(lookup, {"x": "number", "y": "number"}, "number")
    check(Lookup(OPEN, X), {"x": "number"}, "bool")
    with pytest.raises(InputError, match=r"'\[\]' in 'price\[x\]' needs a number where there is a bool"):
        check(Lookup(PRICE, X), {"x": "bool"}, "number")
    assert render(lookup) == "price[x + y]"
    assert render(fold(lookup, {"x": Fraction(1)})) == "price[1 + y]"


def test_a_table_equals_itself_alone_and_has_a_short_repr() -> None:
    other = Table("price", PRICE.column)
    assert Lookup(PRICE, X) == Lookup(PRICE, X)
    assert Lookup(PRICE, X) != Lookup(other, X)
    assert len(repr(Lookup(Table("big", Column.of(np.arange(10**5))), X))) < 300


def test_one_is_not_true() -> None:
    # as keys of a table of formulas they would be
    assert Constant(True) != Constant(Fraction(1))
    assert len({Constant(True), Constant(Fraction(1)), Constant(False), Constant(Fraction(0))}) == 4
