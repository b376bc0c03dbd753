"""The left side of `&`, `|` and `=>` decides alone where it can, and so does the condition of `?:`."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from merap.errors import InputError
from merap.program.expressions import (
    evaluate,
    evaluate_where_defined,
    evaluate_whole,
    fold,
    parse,
    render,
    tabulate,
)


@pytest.mark.parametrize(
    ("text", "folded"),
    [
        ("x > 0 & 1 / n > 1", "x > 0 & 1 / 0 > 1"),
        ("x > 0 | 1 / n > 1", "x > 0 | 1 / 0 > 1"),
        ("x > 0 => 1 / n > 1", "x > 0 => 1 / 0 > 1"),
        ("x > 0 ? 1 / n : 1 + 1", "x > 0 ? 1 / 0 : 2"),
    ],
)
def test_an_undefined_part_stays_where_it_may_never_be_needed(text: str, folded: str) -> None:
    assert render(fold(parse(text), {"n": Fraction(0)})) == folded


@pytest.mark.parametrize(
    ("text", "expected", "defined"),
    [
        ("x > 0 & 8 / x > 2", [False, True, False], [True, True, True]),
        ("x <= 0 | 8 / x > 2", [True, True, False], [True, True, True]),
        ("x > 0 => 8 / x > 2", [True, True, False], [True, True, True]),
        ("8 / x > 2 & x > 0", [None, True, False], [False, True, True]),
        ("x >= 0 & 8 / x > 2", [None, True, False], [False, True, True]),
        ("(8 / x > 2 | true) => x = 2", [None, True, False], [False, True, True]),
    ],
)
def test_the_right_side_counts_only_where_the_left_one_does_not_decide(
    text: str, expected: list[bool | None], defined: list[bool]
) -> None:
    scope = {"x": np.array([0, 2, 4])}
    values, found = evaluate_where_defined(parse(text), scope)
    assert found.tolist() == defined
    assert [
        value if known else None for value, known in zip(values.tolist(), defined, strict=True)
    ] == expected
    numbers, known = evaluate_whole(parse(text), scope)
    assert known.tolist() == defined
    assert numbers[known].tolist() == [int(value) for value in expected if value is not None]
    listed, codes = tabulate(parse(text), scope)
    assert [listed[code] for code in codes] == expected
    if all(defined):
        assert evaluate(parse(text), scope).tolist() == expected
    else:
        with pytest.raises(InputError, match=r"division by zero for some attribute values \(x = 0\)"):
            evaluate(parse(text), scope)
