"""Random MDPs of two to four states, whose every policy can be tried."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import strategies as st

from tests.support.brute_force import SmallMDP


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
