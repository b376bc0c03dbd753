"""Random properties of random models, against fractions and every policy."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.checker.storm import build_text
from tests.support.brute_force import Formula, SmallMDP, satisfying, text_of, values
from tests.support.small_mdps import small_mdps

BOUNDS = [
    Fraction(n, d) for n, d in ((0, 1), (1, 8), (3, 10), (1, 3), (1, 2), (5, 8), (3, 4), (9, 10), (1, 1))
]
SUMS = [Fraction(n, d) for n, d in ((0, 1), (1, 2), (1, 1), (3, 2), (2, 1), (3, 1), (4, 1), (6, 1))]


def operators(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    direction = st.sampled_from(["min", "max", ""])
    compare = st.sampled_from([">=", ">", "<=", "<"])
    paths = st.one_of(
        st.tuples(st.sampled_from(["X", "F", "G"]), inner),
        st.tuples(st.sampled_from(["F<=", "G<="]), st.integers(0, 3), inner),
        st.tuples(st.sampled_from(["U", "W", "R"]), inner, inner),
        st.tuples(st.just("U[]"), st.integers(0, 2), st.integers(2, 4), inner, inner),
    )
    return st.one_of(
        st.tuples(st.just("P"), direction, compare, st.sampled_from(BOUNDS), paths),
        st.tuples(
            *(st.just("R"), st.just("steps"), direction, compare, st.sampled_from(SUMS)),
            st.one_of(st.tuples(st.just("F"), inner), st.tuples(st.just("C<="), st.integers(1, 3))),
        ),
        st.tuples(
            *(
                st.just("R"),
                st.just("objective"),
                direction,
                compare,
                st.sampled_from([*BOUNDS, Fraction(-2, 5)]),
            ),
            st.tuples(st.just("C<="), st.integers(1, 3)),
        ),
    )


def later_paths() -> st.SearchStrategy[Formula]:
    """Paths with a lower bound on time alone, whose values are rounded once more."""
    label = st.tuples(st.just("label"), st.sampled_from(["a", "b"]))
    return st.one_of(
        st.tuples(st.sampled_from(["F>=", "G>="]), st.integers(0, 4), label),
        st.tuples(st.just("U>="), st.integers(0, 4), label, label),
    )


def formulas() -> st.SearchStrategy[Formula]:
    labels = st.tuples(st.just("label"), st.sampled_from(["a", "b"]))
    return st.recursive(
        labels,
        lambda inner: st.one_of(
            st.tuples(st.just("not"), inner),
            st.tuples(st.sampled_from(["and", "or"]), inner, inner),
            operators(inner),
        ),
        max_leaves=4,
    )


@pytest.mark.slow
@settings(max_examples=150, deadline=None, derandomize=True)
@given(mdp=small_mdps(), formula=formulas())
def test_a_truth_value_is_that_of_fractions_whatever_is_nested_in_what(
    mdp: SmallMDP, formula: Formula
) -> None:
    answer = build_text(mdp.prism(), "small").check(text_of(formula))
    assert answer.holds == (0 in satisfying(mdp, formula)), (mdp.prism(), text_of(formula))


@pytest.mark.slow
@settings(max_examples=100, deadline=None, derandomize=True)
@given(mdp=small_mdps(), formula=operators(st.tuples(st.just("label"), st.sampled_from(["a", "b"]))))
def test_the_value_at_the_root_is_that_of_fractions(mdp: SmallMDP, formula: Formula) -> None:
    answer = build_text(mdp.prism(), "small").check(text_of(formula))
    value = values(mdp, formula)[0]
    assert answer.holds == (0 in satisfying(mdp, formula))
    assert answer.value == pytest.approx(float("inf") if value is None else float(value), abs=1e-9)


@pytest.mark.slow
@settings(max_examples=100, deadline=None, derandomize=True)
@given(mdp=small_mdps(), path=later_paths(), best=st.sampled_from(["min", "max"]))
def test_a_lower_bound_on_time_has_the_value_of_fractions(mdp: SmallMDP, path: Formula, best: str) -> None:
    formula = ("P", best, ">=", Fraction(0), path)
    answer = build_text(mdp.prism(), "small").check(text_of(formula).replace(">=0/1", "=?", 1))
    value = values(mdp, formula)[0]
    assert value is not None
    assert answer.lower is not None
    assert answer.upper is not None
    assert answer.value == pytest.approx(float(value), abs=1e-9)
    assert answer.lower <= float(value) <= answer.upper
