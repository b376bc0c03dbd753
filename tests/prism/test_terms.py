from __future__ import annotations

import pytest

from merap.prism.terms import alternatives, bare, condition_of, conjunction


@pytest.mark.parametrize(
    ("text", "expected"),
    [("(a | b)", "a | b"), ("(a) | (b)", "(a) | (b)"), ("a", "a"), ("((a))", "(a)"), ("!(a)", "!(a)")],
)
def test_bare_takes_off_parentheses_around_the_whole(text: str, expected: str) -> None:
    assert bare(text) == expected


def test_a_choice_as_condition_keeps_its_parentheses() -> None:
    assert condition_of("(a | b)") == "a | b"
    assert condition_of("(a ? b : c)") == "(a ? b : c)"
    assert bare("(a ? b : c)") == "a ? b : c"


def test_conjunction_and_alternatives_of_terms() -> None:
    assert conjunction([]) == "true"
    assert conjunction(["true", "a", "true"]) == "a"
    assert conjunction(["a", "b"]) == "(a & b)"
    assert conjunction(["a", "false"]) == "false"
    assert alternatives([]) == "false"
    assert alternatives(["a"]) == "a"
    assert alternatives(["a", "b"]) == "(a | b)"
