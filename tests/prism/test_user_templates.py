"""Templates of users: what is put in, what stays open, and what is refused."""

from __future__ import annotations

from fractions import Fraction

import pytest

from merap.errors import InputError
from merap.prism.user_templates import BranchingError, fill_in_template, template_names

NOTHING: frozenset[str] = frozenset()


def test_constants_are_put_in_and_parameters_keep_their_names() -> None:
    template = "{% for i in range(N) %}\nx{{ i }} : {{ p }} {{ b }} {{ half*2 }} {{ stick }}\n{% endfor %}\n"
    assert template_names(template) == {"N", "p", "b", "half", "stick"}
    values: dict[str, Fraction | bool] = {
        "N": Fraction(2),
        "p": Fraction(1, 10),
        "b": True,
        "half": Fraction(1, 2),
    }
    assert fill_in_template(template, values, frozenset({"stick"})) == (
        "x0 : (1/10) true (1) stick\nx1 : (1/10) true (1) stick\n"
    )


@pytest.mark.parametrize(
    "template",
    [
        "{% if stick %}{% endif %}",
        "{% if stick > 1 %}{% endif %}",
        "{{ stick * 2 }}",
        "{% for i in stick %}{% endfor %}",
    ],
)
def test_more_than_writing_needs_the_value_of_a_parameter(template: str) -> None:
    with pytest.raises(BranchingError, match=r"^stick$"):
        fill_in_template(template, {}, frozenset({"stick"}))


@pytest.mark.parametrize(
    ("template", "line", "message"),
    [
        ("a\n{{ stack }}", 2, "'stack' is undefined"),
        ("a\n\n{{ 1 / 0 }}", 3, "division by zero"),
        ("{% for i in range(10000000) %}{% endfor %}", 1, "Range too big"),
        ("{{ ''.__class__.__mro__ }}", 1, "is unsafe"),
        ("{% include 'other' %}", 1, "no loader"),
    ],
)
def test_what_can_not_be_filled_in_is_refused_with_its_line(template: str, line: int, message: str) -> None:
    with pytest.raises(InputError) as caught:
        fill_in_template(template, {}, NOTHING)
    assert message in caught.value.message
    assert caught.value.line == line


def test_a_syntax_error_has_its_line() -> None:
    with pytest.raises(InputError) as caught:
        template_names("a\n{% if %}")
    assert caught.value.line == 2
