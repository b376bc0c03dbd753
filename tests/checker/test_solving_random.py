"""Random properties of random models, against fractions and every policy."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.checker.storm import build_text
from tests.support.brute_force import Formula, SmallMDP, satisfying, text_of, values

BOUNDS = [
    Fraction(n, d) for n, d in ((0, 1), (1, 8), (3, 10), (1, 3), (1, 2), (5, 8), (3, 4), (9, 10), (1, 1))
]
SUMS = [Fraction(n, d) for n, d in ((0, 1), (1, 2), (1, 1), (3, 2), (2, 1), (3, 1), (4, 1), (6, 1))]


@st.composite
def small_mdps(draw: st.DrawFn) -> SmallMDP:
    size = draw(st.integers(2, 4))
    states = st.integers(0, size - 1)
    choices, steps, objective = [], [], []
    for _ in range(size):
        mine = []
        for _ in range(draw(st.integers(1, 2))):
            chance = draw(st.sampled_from([Fraction(1), Fraction(1, 2), Fraction(3, 10), Fraction(1, 3)]))
            successors = {draw(states): chance}
            other = draw(states)
            if chance < 1:
                successors[other] = successors.get(other, Fraction(0)) + 1 - chance
            mine.append(successors)
        choices.append(tuple(mine))
        steps.append(tuple(Fraction(draw(st.integers(0, 2))) for _ in mine))
        objective.append(tuple(Fraction(draw(st.integers(-4, 4)), 10) for _ in mine))
    return SmallMDP(
        choices=tuple(choices),
        rewards={"objective": tuple(objective), "steps": tuple(steps)},
        labels={name: frozenset(draw(st.sets(states))) for name in ("a", "b")},
    )


def operators(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    direction = st.sampled_from(["min", "max", ""])
    compare = st.sampled_from([">=", ">", "<=", "<"])
    paths = st.one_of(
        st.tuples(st.sampled_from(["X", "F", "G"]), inner),
        st.tuples(st.just("F<="), st.integers(0, 3), inner),
        st.tuples(st.just("U"), inner, inner),
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
