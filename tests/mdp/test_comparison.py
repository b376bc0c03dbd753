"""Two models side by side: the same, or how they differ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.comparison import compare
from merap.mdp.model import TabularMDP
from tests.support.mdp_examples import Choices, large_grid, make_mdp, random_mdp
from tests.support.mdp_routes import shuffled

BASE: Choices = {
    (0, 0): {"go": (1.0, {(0, 1): 0.5, (1, 0): 0.5}), "rest": (0.0, {(0, 0): 1.0})},
    (0, 1): {"go": (2.0, {(1, 0): 1.0})},
    (1, 0): {"rest": (0.0, {(1, 0): 1.0})},
}


def base() -> TabularMDP:
    return make_mdp(BASE, variables=("x", "y"), labels={"top": {(1, 0)}, "own": set()})


def other(changes: Choices) -> TabularMDP:
    labels = {"top": {(1, 0)}, "else": {(0, 0)}}
    return make_mdp({**BASE, **changes}, variables=("x", "y"), labels=labels)


@pytest.mark.parametrize("seed", range(10))
def test_order_does_not_matter(seed: int) -> None:
    generator = np.random.default_rng(seed)
    mdp = random_mdp(generator)
    result = compare(mdp, shuffled(generator, mdp))
    assert result.same
    assert result.same_states
    assert result.same_actions
    assert result.same_probabilities
    assert result.same_rewards
    assert result.same_initial
    assert result.same_labels
    assert result.max_probability_difference == result.max_reward_difference == 0
    result.require_same()


def test_unreachable_states_and_foreign_labels_do_not_count() -> None:
    changed = other({(5, 5): {"jump": (7.0, {(0, 0): 1.0})}})
    assert compare(base(), changed).same
    assert compare(changed, base()).same


def same_but(**flags: bool) -> dict[str, bool]:
    kinds = ("states", "actions", "probabilities", "rewards", "initial", "labels")
    return {f"same_{kind}": flags.get(kind, True) for kind in kinds}


@pytest.mark.parametrize(
    ("changed", "flags", "lines"),
    [
        (
            lambda: other({(0, 1): {"go": (2.0, {(2, 2): 1.0})}, (2, 2): {"rest": (0.0, {(2, 2): 1.0})}}),
            same_but(states=False, probabilities=False),
            (
                "state (x=2, y=2) only in the second",
                "(x=0, y=1), action go: probabilities differ by up to 1",
            ),
        ),
        (
            lambda: other({(1, 0): {"rest": (0.0, {(1, 0): 1.0}), "nap": (0.0, {(1, 0): 1.0})}}),
            same_but(actions=False),
            ("(x=1, y=0), action nap: enabled only in the second",),
        ),
        (
            lambda: other({(0, 1): {"rest": (2.0, {(1, 0): 1.0})}}),
            same_but(actions=False),
            (
                "(x=0, y=1), action go: enabled only in the first",
                "(x=0, y=1), action rest: enabled only in the second",
            ),
        ),
        (
            lambda: other({(0, 0): {**BASE[(0, 0)], "go": (1.0, {(0, 1): 0.25, (1, 0): 0.75})}}),
            same_but(probabilities=False),
            ("(x=0, y=0), action go: probabilities differ by up to 0.25",),
        ),
        (
            lambda: other({(0, 1): {"go": (2.5, {(1, 0): 1.0})}}),
            same_but(rewards=False),
            ("(x=0, y=1), action go: reward 2.0 in the first, 2.5 in the second",),
        ),
        (
            lambda: replace(other({}), initial=np.array([0.75, 0.25, 0.0])),
            same_but(initial=False),
            (
                "(x=0, y=0): initial probability 1.0 in the first, 0.75 in the second",
                "(x=0, y=1): initial probability 0.0 in the first, 0.25 in the second",
            ),
        ),
        (
            lambda: replace(other({}), labels={"top": np.array([True, False, False])}),
            same_but(labels=False),
            (
                "label 'top' at (x=1, y=0) only in the first",
                "label 'top' at (x=0, y=0) only in the second",
            ),
        ),
    ],
)
def test_each_difference_is_described(
    changed: Callable[[], TabularMDP], flags: dict[str, bool], lines: tuple[str, ...]
) -> None:
    result = compare(base(), changed())
    assert result.differences == lines
    assert {name: getattr(result, name) for name in flags} == flags
    with pytest.raises(ModelError, match="the models differ: "):
        result.require_same()


def test_tolerances_and_largest_deviations() -> None:
    near = other(
        {(0, 0): {"go": (1 + 1e-8, {(0, 1): 0.5 + 1e-10, (1, 0): 0.5 - 1e-10}), "rest": BASE[(0, 0)]["rest"]}}
    )
    strict = compare(base(), near)
    assert not strict.same_probabilities
    assert not strict.same_rewards
    assert strict.max_probability_difference == pytest.approx(1e-10, rel=1e-5)
    assert strict.max_reward_difference == pytest.approx(1e-8, rel=1e-5)
    assert compare(base(), near, probability_tolerance=1e-9, reward_tolerance=1e-7).same


def test_only_the_first_differences_of_a_kind_are_described() -> None:
    mdp = large_grid(450)
    doubled = replace(mdp, choice_reward=2 * mdp.choice_reward)
    result = compare(mdp, doubled)
    assert len(result.differences) == 3
    assert result.max_reward_difference == 1
    assert result.same_probabilities


def test_models_with_nothing_in_common() -> None:
    one = make_mdp({(0,): {"stay": (0.0, {(0,): 1.0})}})
    two = make_mdp({(1,): {"stay": (0.0, {(1,): 1.0})}})
    result = compare(one, two)
    assert not result.same_states
    assert not result.same_initial
    assert result.max_probability_difference == 0
    assert result.max_initial_difference == 1


def test_other_variables_are_an_error() -> None:
    with pytest.raises(ModelError, match="variable 's' of the model is not one of x, y"):
        compare(base(), random_mdp(np.random.default_rng(0)))
