"""Tables over locations and other variables, against the expression that they stand for."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merap.errors import InputError
from merap.prism.engine_text import text_of
from merap.prism.value_tables import Domains, least_of, table_of
from merap.program.expressions import (
    Column,
    Constant,
    Expression,
    Lookup,
    Operation,
    Table,
    Value,
    Variable,
    fold,
    parse,
)
from merap.program.form import StateVariable, boolean, integer

ROWS, COLUMNS = 3, 4


def domains(*variables: StateVariable, location: tuple[str, ...] = ("row", "col")) -> Domains:
    return Domains({one.name: one for one in variables}, location)


DOMAINS = domains(
    integer("row", 0, ROWS - 1), integer("col", 0, COLUMNS - 1), integer("m", -1, 2), boolean("b")
)
HERE = parse(f"{COLUMNS} * row + col")


def tables(draw: st.DrawFn) -> Expression:
    size = ROWS * COLUMNS
    numbers = draw(st.lists(st.sampled_from([0.1, 0.2, 3.0]), min_size=size, max_size=size))
    return Lookup(Table("light", Column.of(np.array(numbers))), HERE)


@st.composite
def expressions(draw: st.DrawFn) -> Expression:
    light = tables(draw)
    form = draw(
        st.sampled_from(
            [
                "light",
                "light * m",
                "b ? light : m / 3",
                "light > m / 10",
                "b & light = 3",
                "1 / m",
                "row + m > col",
            ]
        )
    )
    return put(parse(form), light)


def put(expression: Expression, light: Expression) -> Expression:
    if isinstance(expression, Variable):
        return light if expression.name == "light" else expression
    if isinstance(expression, Operation):
        return Operation(expression.operator, tuple(put(part, light) for part in expression.arguments))
    return expression


def value_in(expression: Expression, state: dict[str, Value]) -> Value | None:
    try:
        folded = fold(expression, state)
    except InputError:
        return None
    assert isinstance(folded, Constant)
    return folded.value


@given(expressions())
def test_a_table_has_the_values_of_the_expression(expression: Expression) -> None:
    tree = parse(text_of(table_of(expression, DOMAINS)))
    found = []
    for row, col, m, b in product(range(ROWS), range(COLUMNS), range(-1, 3), (False, True)):
        state: dict[str, Value] = {"row": Fraction(row), "col": Fraction(col), "m": Fraction(m), "b": b}
        expected = value_in(expression, state)
        if expected is not None:
            assert value_in(tree, state) == expected
            found.append(expected)
    if not isinstance(found[0], bool):
        assert least_of(expression, DOMAINS) == min(map(Fraction, found))


def test_locations_do_not_count_as_cases() -> None:
    rows, columns = 100, 100
    wide = domains(integer("row", 0, rows - 1), integer("col", 0, columns - 1), integer("m", 0, 3))
    blocked = np.random.default_rng(0).random(rows * columns) < 0.01
    lookup = Lookup(Table("blocked", Column.of(blocked)), parse(f"{columns} * row + col"))
    text = text_of(table_of(Operation("?:", (lookup, parse("m / 3"), parse("0"))), wide))
    assert 100 < len(text) < 4 * 100 * 60
    apart = Domains(wide.variables)
    with pytest.raises(InputError, match="has 10000 cases, at most 4096 can be listed"):
        table_of(lookup, apart)


def test_what_is_nowhere_defined_has_some_value_of_its_type() -> None:
    assert table_of(parse("1 / (m - m)"), DOMAINS) == Constant(Fraction(0))
    assert table_of(parse("1 / (m - m) > 1"), DOMAINS) == Constant(False)
    assert least_of(parse("1 / (m - m)"), DOMAINS) == 0


def test_a_range_that_no_table_holds_is_refused_before_its_values_are_listed() -> None:
    with pytest.raises(InputError, match="an expression over x has 4000000000001 cases"):
        table_of(Variable("x", 1), Domains({"x": integer("x", 0, 4_000_000_000_000)}))
