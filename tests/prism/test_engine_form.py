from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merap.prism.engine_form import engine_form, is_table
from merap.program.expressions import evaluate, render
from tests.support.hand_made import parsed

SCOPE = {
    "ice": np.tile([False, True], 12),
    "light": np.repeat([0.0, 1.0, 2.0, 3.0], 6),
    "tilt": np.tile([-3.0, -1.0, 0.0, 2.0], 6),
}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 - (ice ? 0.8 : 1)", "ice ? 1/5 : 0"),
        ("(ice ? 0.8 : 1) / 2", "ice ? 2/5 : 1/2"),
        ("-(ice ? 1 : 2)", "ice ? -1 : -2"),
        ("2 * (ice ? light : 3)", "ice ? 2 * light : 6"),
        ("1 - (ice ? (light > 1 ? 0.1 : 0.2) : 1)", "ice ? (light > 1 ? 9/10 : 4/5) : 0"),
        ("max(0, ice ? -1 : 1)", "ice ? 0 : 1"),
        ("1 - light", "1 - light"),
        ("(ice ? 1 : 2) - (light > 1 ? 1 : 2)", "(ice ? 1 : 2) - (light > 1 ? 1 : 2)"),
        ("1 / (ice ? 2 : 0)", "1 / (ice ? 2 : 0)"),
        ("mod(light, 2)", "light - 2 * floor(light / 2)"),
        ("light > light", "false"),
        ("light <= light & ice", "ice"),
        ("false & ice", "false"),
        ("ice | 1 < 2", "true"),
        ("false | false", "false"),
        ("light > light ? 1 : 2", "2"),
    ],
)
def test_forms(text: str, expected: str) -> None:
    assert render(engine_form(parsed(text))) == expected


EXPRESSIONS = st.recursive(
    st.sampled_from(["light", "tilt", "2", "0.5", "0", "(ice ? 1 : 0.25)", "(tilt < light ? 3 : tilt)"]),
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from("+-*"), inner),
        st.builds("(-{})".format, inner),
        st.builds("({} / 4)".format, inner),
        st.builds("{}({}, {})".format, st.sampled_from(["min", "max"]), inner, inner),
        st.builds("mod({}, {})".format, inner, st.sampled_from(["2", "3", "-2"])),
        st.builds("({} <= {} & ice | {} > 1 ? {} : {})".format, inner, inner, inner, inner, inner),
    ),
    max_leaves=6,
)


@given(EXPRESSIONS)
def test_the_value_stays_the_same(text: str) -> None:
    expression = parsed(text)
    one, other = (
        np.broadcast_to(evaluate(form, SCOPE), 24) for form in (engine_form(expression), expression)
    )
    assert one == pytest.approx(other, abs=1e-9)


def test_a_table_has_a_constant_in_every_case() -> None:
    assert is_table(parsed("0.5"))
    assert is_table(parsed("ice ? 0.5 : light > 1 ? 0 : 1"))
    assert not is_table(parsed("ice ? light / 4 : 1"))
    assert not is_table(parsed("light / 4"))
