"""No comparison is decided on a rounded number: fractions in plain Python are the third route."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from merap.checker.combination_model import build_combination
from merap.concerns.combination import Combination
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.model import TabularMDP
from merap.program.expressions import Column, evaluate, parse, tabulate
from tests.support.exact_expressions import Sample, numbers, truths
from tests.support.mdp_lookup import reward, step

RELAXED = settings(deadline=None, suppress_health_check=list(HealthCheck))
MANY, FEW = settings(RELAXED, max_examples=100), settings(RELAXED, max_examples=15)

R = np.array([0.1, 0.2, 0.3, 0.7, -0.1, 1e15, 123456789.12345])
N = np.array([0, 3, -7, 10**15, 2, 9_007_199_254, 1])
B = np.array([True, False, True, False, False, True, True])
SCOPE = {"r": R, "n": N, "b": B}
ROWS = [
    {"r": Fraction(repr(float(r))), "n": Fraction(int(n)), "b": bool(b)}
    for r, n, b in zip(R, N, B, strict=True)
]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # by hand, at r = 0.1
        ("r + 0.2 <= 0.3", True),
        ("r * 3 = 0.3", True),
        ("1 - 0.9 - r = 0", True),
        ("mod(0.3, r) = 0", True),
        ("floor(0.7 / r) = 7", True),
        ("pow(r, 2) = 0.01", True),
        ("min(r + 0.2, 0.3) < 0.3", False),
        ("(r > 0 ? r : 0) + 0.7 != 0.8", False),
        # integers beyond 2^53, at r = 0.1
        ("r * 10 + 9007199254740992 > 9007199254740992", True),
        ("r * 90071992547409930 = 9007199254740993", True),
        ("r * 1e30 + 1 > r * 1e30", True),
    ],
)
def test_comparisons_that_doubles_get_wrong(text: str, expected: bool) -> None:
    assert evaluate(parse(text), {"r": np.array([0.1])}).tolist() == [expected]


def test_values_beyond_doubles_keep_their_digits() -> None:
    scope = {"n": Column.of(np.array([10**15, 3]))}
    values, codes = tabulate(parse("n * n + 1"), scope)
    assert [values[code] for code in codes] == [10**30 + 1, 10]
    difference = "(n + 9007199254740993) - 9007199254740992"
    assert evaluate(parse(difference), {"n": np.array([0])}).tolist() == [1.0]


@pytest.mark.parametrize("shift", [0, 2**62 - 40_000, 2**63 - 50_001, -(2**63)])
def test_many_whole_numbers_are_compared_exactly(shift: int) -> None:
    array = np.array([shift, shift + 7, shift + 50_000], dtype=np.int64)
    column = Column.of(array)
    expected = [int(value) * 10 + 1 > 10 * (shift + 7) for value in array]
    scope = {"n": column, "m": Column.of(np.array([shift + 7]))}
    assert evaluate(parse("n * 10 + 1 > 10 * m"), scope).tolist() == expected
    values, codes = tabulate(parse("n"), scope)
    assert [values[code] for code in codes] == array.tolist()
    assert column.levels.values == tuple(map(Fraction, array.tolist()))


def test_roots_are_exact_where_they_are_rational() -> None:
    x = np.array([0.0, 0.25, 2.0])
    assert evaluate(parse("pow(x, 0.5)"), {"x": x}).tolist() == [0, 0.5, math.sqrt(2)]
    assert evaluate(parse("pow(x, 0.5) = 0.5"), {"x": x}).tolist() == [False, True, False]


@MANY
@given(sample=truths(3, ("r", "n"), ("b",)))
def test_conditions_against_plain_python(sample: Sample) -> None:
    expected = [sample.value(row) for row in ROWS]
    assert np.broadcast_to(evaluate(parse(sample.text), SCOPE), len(ROWS)).tolist() == expected


@MANY
@given(sample=numbers(3, ("r", "n"), ("b",)))
def test_numbers_against_plain_python(sample: Sample) -> None:
    columns = {name: Column.of(array) for name, array in SCOPE.items()}
    values, codes = tabulate(parse(sample.text), columns)
    found = [values[code] for code in np.broadcast_to(codes, len(ROWS))]
    assert found == [sample.value(row) for row in ROWS]


@MANY
@given(sample=numbers(2, ("r", "n")), seed=st.integers(0, 2**32 - 1))
def test_many_distinct_values_against_plain_python(sample: Sample, seed: int) -> None:
    """So many that combinations are sorted instead of counted, with more digits than 64 bits hold."""
    generator = np.random.default_rng(seed)
    r, n = generator.random(60), generator.integers(-(10**15), 10**15, 60)
    expected = [
        float(sample.value({"r": Fraction(repr(x)), "n": Fraction(y)}))
        for x, y in zip(r.tolist(), n.tolist(), strict=True)
    ]
    assert np.broadcast_to(evaluate(parse(sample.text), {"r": r, "n": n}), 60).tolist() == expected


# A line of places, each with its own attribute values.
REALS = ["0.1", "0.2", "0.3", "-0.7", "0.30000000000000004"]
WHOLES = [0, 3, 7, 10**15, -5]


def case_with(**objective: Any) -> dict[str, Any]:
    places = [f"p{index}" for index in range(len(REALS))]
    chance = objective.pop("chance", "0.5")
    return {
        "case": "line",
        "discount": 1,
        "space": {
            "locations": {place: [index, 0] for index, place in enumerate(places)},
            "edges": [[a, b, "on"] for a, b in zip(places, [*places[1:], places[0]], strict=True)],
            "attributes": {
                "r": {
                    "type": "real",
                    "range": [-1e6, 1e6],
                    "values": {place: float(text) for place, text in zip(places, REALS, strict=True)},
                },
                "n": {
                    "type": "int",
                    "range": [-(10**15), 10**15],
                    "values": dict(zip(places, WHOLES, strict=True)),
                },
            },
        },
        "environment": {"configurations": {"e": {}}},
        "capability": {
            "parameters": {"p": "real"},
            "actions": {"stop": {"stay": 1}, "go": {"move": "on", "probability": chance}},
            "configurations": {"c": {"p": 0.1}},
        },
        "objective": {
            "parameters": {"q": "real"},
            "start": [{"at": place, "probability": 0.2} for place in places],
            "horizon": 3,
            "configurations": {"o": {"q": 0.2}},
            **objective,
        },
    }


def loaded(folder: Path, case: dict[str, Any]) -> Combination:
    path = folder / "case.yaml"
    path.write_text(json.dumps(case))
    return load_case(path).combination("e.c.o")


def both_routes(combination: Combination) -> list[TabularMDP]:
    return [explored(combination), build_combination(combination).mdp]


def surroundings(place: int, following: int | None = None) -> dict[str, Fraction]:
    known = {"r": Fraction(REALS[place]), "n": Fraction(WHOLES[place])}
    known |= {"p": Fraction(1, 10), "q": Fraction(1, 5)}
    if following is not None:
        known |= {"r'": Fraction(REALS[following]), "n'": Fraction(WHOLES[following])}
    return known


def chance_of_going(mdp: TabularMDP, place: int) -> float:
    following = (place + 1) % len(REALS)
    names = mdp.variable_names
    valuation = tuple({"loc": place, "mode": 0, "done": 0}[name] for name in names)
    return sum(
        prob for target, prob in step(mdp, valuation, "go").items() if target[names.index("loc")] == following
    )


@FEW
@given(condition=truths(2, ("r", "n", "r'", "n'", "p")))
def test_probabilities_by_three_routes(tmp_path: Path, condition: Sample) -> None:
    chance = f"{condition.text} ? 1 : 0.25"
    combination = loaded(tmp_path, case_with(chance=chance))
    for mdp in both_routes(combination):
        for place in range(len(REALS)):
            holds = condition.value(surroundings(place, (place + 1) % len(REALS)))
            assert chance_of_going(mdp, place) == (1 if holds else 0.25)


@FEW
@given(value=numbers(2, ("r", "n", "p")))
def test_computed_probabilities_by_three_routes(tmp_path: Path, value: Sample) -> None:
    """A probability of 0 is 0, and its complement 1."""
    combination = loaded(tmp_path, case_with(chance=f"min(1, max(0, {value.text}))"))
    for mdp in both_routes(combination):
        for place in range(len(REALS)):
            expected = float(min(1, max(0, value.value(surroundings(place)))))
            assert chance_of_going(mdp, place) == pytest.approx(expected, rel=1e-12, abs=0)


@FEW
@given(
    condition=truths(2, ("r", "n", "r'", "n'", "q")),
    value=numbers(2, ("r", "n", "r'", "q")),
    bound=st.sampled_from([1000, 10**12]),
)
def test_rewards_by_three_routes(tmp_path: Path, condition: Sample, value: Sample, bound: int) -> None:
    rules = [
        {"where": condition.text, "value": f"max(-{bound}, min({bound}, {value.text}))"},
        {"value": -0.3},
    ]
    combination = loaded(tmp_path, case_with(rewards=rules))
    for mdp in both_routes(combination):
        for place in range(len(REALS)):
            known = surroundings(place, place)
            expected = max(-bound, min(bound, value.value(known))) if condition.value(known) else -0.3
            valuation = tuple({"loc": place, "mode": 0, "done": 0}[name] for name in mdp.variable_names)
            assert reward(mdp, valuation, "stop") == pytest.approx(float(expected), rel=1e-12, abs=1e-10)


@FEW
@given(condition=truths(2, ("r", "n", "q")), key=st.sampled_from(["ends_in", "unsafe"]))
def test_conditions_on_states_by_three_routes(tmp_path: Path, condition: Sample, key: str) -> None:
    combination = loaded(tmp_path, case_with(**{key: {"where": condition.text}}))
    label = "done" if key == "ends_in" else "unsafe"
    for mdp in both_routes(combination):
        place = mdp.valuations[:, mdp.variable_names.index("loc")]
        for state, holds in enumerate(mdp.labels[label].tolist()):
            assert holds == condition.value(surroundings(int(place[state])))


@FEW
@given(condition=truths(2, ("r", "n", "q")))
def test_steps_that_end_the_task_by_three_routes(tmp_path: Path, condition: Sample) -> None:
    combination = loaded(tmp_path, case_with(ends_after={"action": "stop", "where": condition.text}))
    for mdp in both_routes(combination):
        done = mdp.variable_names.index("done")
        for place in range(len(REALS)):
            valuation = tuple({"loc": place, "mode": 0, "done": 0}[name] for name in mdp.variable_names)
            (target,) = step(mdp, valuation, "stop")
            assert target[done] == condition.value(surroundings(place))


def test_the_probability_of_the_report(tmp_path: Path) -> None:
    """r is 0.1 at p0: 0.1 + 0.2 <= 0.3 holds, though it does not for doubles."""
    for mdp in both_routes(loaded(tmp_path, case_with(chance="(r + 0.2 <= 0.3) ? 1 : 0"))):
        assert [chance_of_going(mdp, place) for place in range(5)] == [1, 0, 0, 1, 0]


def test_a_probability_below_zero_is_refused_however_small(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="an outcome has the probability -1e-13, not in"):
        loaded(tmp_path, case_with(chance="r = 0.1 ? -0.0000000000001 : 0.5"))
