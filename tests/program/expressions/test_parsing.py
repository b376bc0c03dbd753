from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.errors import InputError
from merap.program.expressions import (
    Constant,
    Expression,
    Kind,
    Operation,
    Variable,
    check,
    evaluate,
    exact,
    fold,
    parse,
    render,
    variables,
)

KINDS: dict[str, Kind] = {"x": "number", "z": "number", "y": "bool"}
# Every combination of the three variables' values: 4 * 2 * 3 rows.
X, Y, Z = (column.ravel() for column in np.meshgrid(np.arange(4), [False, True], np.arange(3), indexing="ij"))
SCOPE: dict[str, npt.NDArray[Any]] = {"x": X, "y": Y, "z": Z}


def value(text: str, **constants: Fraction | bool) -> Fraction | bool:
    folded = fold(parse(text), constants)
    assert isinstance(folded, Constant)
    return folded.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # Arithmetic by hand; numbers are decimals, not doubles: 0.1 + 0.2 is 3/10.
        ("0.1 + 0.2", Fraction(3, 10)),
        ("1 - 2 - 3", Fraction(-4)),
        ("8 / 4 / 2", Fraction(1)),
        ("2 * -3", Fraction(-6)),
        ("--1", Fraction(1)),
        ("1e-2", Fraction(1, 100)),
        ("-7 / 2", Fraction(-7, 2)),
        ("floor(-7 / 2)", Fraction(-4)),
        ("ceil(-7 / 2)", Fraction(-3)),
        ("mod(-7, 2)", Fraction(1)),
        ("pow(2, -2)", Fraction(1, 4)),
        ("min(3, 1, 2) + max(3, 1, 2)", Fraction(4)),
        # PRISM's precedence: & before |, = before !, ?: last, => to the left.
        ("true | false & false", True),
        ("!1 = 2", True),
        ("false => true => false", False),
        ("true <=> false | true", True),
        ("1 < 2 = true", True),
        ("1 + 1 = 2 ? 3 : 4", Fraction(3)),
        ("false ? 1 : true ? 2 : 3", Fraction(2)),
        ("true = true=>false", False),
        # Only the side that is taken is computed.
        ("0 = 0 ? 1 : 1 / 0", Fraction(1)),
        # The left side decides, then the right one need not be defined.
        ("false & 1 / 0 > 1", False),
        ("true | 1 / 0 > 1", True),
        ("false => 1 / 0 > 1", True),
        ("!(true | mod(1, 0) = 0) & pow(0, -1) = 1", False),
    ],
)
def test_constant_expressions(text: str, expected: Fraction | bool) -> None:
    assert value(text) == expected


def test_constants_are_put_in() -> None:
    assert value("grip * 0.8", grip=exact(0.95)) == Fraction(19, 25)
    assert render(fold(parse("x > n ? a : b"), {"n": Fraction(2), "a": True})) == "x > 2 ? true : b"
    assert render(fold(parse("strong ? x : 1 / 0"), {"strong": True})) == "x"
    assert render(fold(parse("strong & b"), {"strong": True})) == "b"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("light = = 0", "syntax error at column 9 of 'light = = 0'"),
        ("(light", "syntax error at column 7 of '(light'"),
        ("", "syntax error at column 1 of ''"),
        ("light @ 0", "syntax error at column 7"),
        ("1 2", "syntax error at column 3"),
        ("a ? b", "syntax error at column 6"),
        ("min(1)", "min at column 1 takes at least 2 argument(s), got 1"),
        ("1 + floor(1, 2)", "floor at column 5 takes 1 argument(s), got 2"),
        ("1e999", "a number is beyond 1000 bits"),
        ("1" * 51, "the number at column 1 has more than 50 digits"),
        ("!" * 150 + "y", "nested deeper than 100"),
        ("!" * 5000 + "y", "nested too deeply"),
        ("x" * 10_001, "has 10001 characters, at most 10000 are allowed"),
        (f"{'x + ' * 60}=", "syntax error at column 241 of ...' + x + x"),
    ],
)
def test_syntax_errors_name_the_column(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(text)
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("text", "expected", "message"),
    [
        ("x + w > 0", "bool", "unknown variable 'w' at column 5"),
        ("x", "bool", "'x' is a number, expected a bool"),
        ("x > 0", "number", "'x > 0' is a bool, expected a number"),
        ("x + y", "number", "'+' in 'x + y' needs a number where there is a bool"),
        ("-y", "number", "'-' in '-y' needs a number where there is a bool"),
        ("!x", "bool", "'!' in '!x' needs a bool where there is a number"),
        ("x = y", "bool", "'=' in 'x = y' needs a number where there is a bool"),
        ("x ? 1 : 2", "number", "'?:' in 'x ? 1 : 2' needs a bool where there is a number"),
        ("y ? 1 : false", "number", "needs a number where there is a bool"),
    ],
)
def test_types_are_checked(text: str, expected: Kind, message: str) -> None:
    with pytest.raises(InputError) as caught:
        check(parse(text), KINDS, expected)
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 / 0", "division by zero"),
        ("mod(1, 0)", "mod by zero"),
        ("pow(2, 0.5)", "pow(2, 1/2) is not a rational number"),
        ("pow(0, -1)", "is not a rational number"),
        ("pow(2, 65)", "the exponent 65 is beyond 64"),
        ("pow(pow(99, 64), 64)", "a number is beyond 1000 bits"),
        ("true & 1 / 0 > 1", "division by zero"),
        ("1 / 0 > 1 & false", "division by zero"),
        ("1 / 0 > 1 | true", "division by zero"),
    ],
)
def test_undefined_constants_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        fold(parse(text), {})
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("6 / x", "division by zero for some attribute values (x = 0)"),
        ("mod(6, x)", "mod by zero for some attribute values (x = 0)"),
        (
            "y ? pow(2, x * 30) : 1",
            "the exponent 90 is beyond 64 for some attribute values (x = 3, y = true)",
        ),
        ("pow(x - 3, 0.5)", "pow(-3, 1/2) is not a real number for some attribute values (x = 0)"),
        ("pow(1e290 * (x + 1), 2.5)", "a number is beyond 1000 bits for some attribute values"),
        ("pow(pow(x + 1, 64), 64)", "a number is beyond 1000 bits for some attribute values (x = 1)"),
    ],
)
def test_undefined_values_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        evaluate(parse(text), SCOPE)
    assert message in caught.value.message


def test_each_side_of_a_choice_is_evaluated_only_where_it_is_taken() -> None:
    x = np.array([0.0, 2.0, 4.0])
    np.testing.assert_array_equal(evaluate(parse("x > 0 ? 8 / x : -1"), {"x": x}), [-1, 4, 2])
    np.testing.assert_array_equal(evaluate(parse("y ? 8 / x : 0"), {"x": x, "y": x > 0}), [0, 4, 2])


def test_evaluation_broadcasts() -> None:
    column, row = np.array([[1.0], [2.0]]), np.array([3.0, 4.0, 5.0])
    result = evaluate(parse("a > 1 ? a * b : b"), {"a": column, "b": row})
    np.testing.assert_array_equal(result, [[3, 4, 5], [6, 8, 10]])


def test_a_label_is_a_condition_in_quotes() -> None:
    expression = parse('x > 0 & !"goal"')
    assert [(one.name, one.column) for one in variables(expression)] == [("x", 1), ('"goal"', 10)]
    check(expression, {"x": "number", '"goal"': "bool"}, "bool")
    with pytest.raises(InputError, match='unknown label "goal" at column 10; there are none'):
        check(expression, {"x": "number"}, "bool")


def test_variables_in_order_with_columns() -> None:
    found = [(variable.name, variable.column) for variable in variables(parse("b + a' * b"))]
    assert found == [("b", 1), ("a'", 5), ("b", 10)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.8", "4/5"),
        ("x * 0.8", "x * (4/5)"),
        ("0.8 * x", "4/5 * x"),
        ("x + (0 - 0.5)", "x + (0 - 1/2)"),
        ("x - (z - 1)", "x - (z - 1)"),
        ("(x - z) - 1", "x - z - 1"),
        ("!(x = z)", "!(x = z)"),
        ("(!y) = y", "(!y) = y"),
        ("y => y => y", "(y => y) => y"),
        ("y <=> x > 1", "y = x > 1"),
        ("(y ? 1 : 2) + 3", "(y ? 1 : 2) + 3"),
        ("min(x, z + 1)", "min(x, z + 1)"),
    ],
)
def test_text_has_fractions_and_few_parentheses(text: str, expected: str) -> None:
    assert render(parse(text)) == expected


def test_a_negative_constant_gets_parentheses_inside_an_operation() -> None:
    assert render(fold(parse("x * n"), {"n": Fraction(-1, 2)})) == "x * (-1/2)"
    assert render(parse("light' > 1"), lambda name: name.replace("'", "_there")) == "light_there > 1"


# Quarters: doubles hold them and their products exactly, so both routes must agree to the bit.
quarters = st.integers(-12, 12).map(lambda numerator: Constant(Fraction(numerator, 4)))
numbers: st.SearchStrategy[Expression] = st.one_of(
    st.sampled_from([Variable("x", 1), Variable("z", 1)]), quarters
)
truths: st.SearchStrategy[Expression] = st.sampled_from([Variable("y", 1), Constant(True), Constant(False)])


def _grow_numbers(depth: int) -> st.SearchStrategy[Expression]:
    if depth == 0:
        return numbers
    inner, condition = _grow_numbers(depth - 1), _grow_truths(depth - 1)
    return st.one_of(
        inner,
        st.builds(Operation, st.sampled_from(["+", "-", "*", "min", "max"]), st.tuples(inner, inner)),
        st.builds(Operation, st.sampled_from(["neg", "floor", "ceil"]), st.tuples(inner)),
        st.builds(Operation, st.just("?:"), st.tuples(condition, inner, inner)),
    )


def _grow_truths(depth: int) -> st.SearchStrategy[Expression]:
    if depth == 0:
        return truths
    inner, number = _grow_truths(depth - 1), _grow_numbers(depth - 1)
    return st.one_of(
        inner,
        st.builds(Operation, st.sampled_from(["=>", "<=>", "|", "&", "=", "!="]), st.tuples(inner, inner)),
        st.builds(Operation, st.sampled_from(["<", "<=", ">", ">=", "=", "!="]), st.tuples(number, number)),
        st.builds(Operation, st.just("!"), st.tuples(inner)),
        st.builds(Operation, st.just("?:"), st.tuples(inner, inner, inner)),
    )


@settings(deadline=None, max_examples=150)
@given(expression=_grow_truths(3))
def test_text_parses_back_to_the_same_function(expression: Expression) -> None:
    """Second route: the text, read again, gives the same values as the tree."""
    check(expression, KINDS, "bool")
    expected = np.broadcast_to(evaluate(expression, SCOPE), X.shape)
    again = parse(render(expression))
    np.testing.assert_array_equal(np.broadcast_to(evaluate(again, SCOPE), X.shape), expected)


@settings(deadline=None, max_examples=150)
@given(expression=_grow_truths(3), row=st.integers(0, len(X) - 1))
def test_folding_agrees_with_evaluation(expression: Expression, row: int) -> None:
    """Second route: exact fractions in one row against doubles in all rows."""
    constants: dict[str, Fraction | bool] = {
        "x": Fraction(int(X[row])),
        "z": Fraction(int(Z[row])),
        "y": bool(Y[row]),
    }
    folded = fold(expression, constants)
    values = np.broadcast_to(evaluate(expression, SCOPE), X.shape)
    assert folded == Constant(bool(values[row]))
