from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from merap.belief.equivalence import EquivalenceClass, alike_for_good, alike_so_far
from merap.belief.posterior import prior_belief, weights
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import CaseStudy, load_declared_case
from merap.mdp.comparison import compare
from tests.support.belief_routes import STRIP, inferred, log_likelihood, trajectory
from tests.support.case_examples import write_case
from tests.support.paths import MODELS
from tests.support.placed import index_of, model_of

NOISE = 0.3
# `far` blocks what `lame` may not enter; under `shut` and `shut_far` nothing beyond the start is reached.
CASE = STRIP.replace(
    "a: {blocked: [[0, 1]]}, b: {blocked: [[1, 1]]}",
    "none: {blocked: []}, far: {blocked: [[1, 2]]}, b: {blocked: [[1, 1]]}, "
    "shut: {blocked: [[0, 1], [1, 0]]}, shut_far: {blocked: [[0, 1], [1, 0], [1, 2]]}",
)
DETECTOR = "right: [0, 1]}}\n  detectors: {sonar: {of: blocked, range: RANGE, accuracy: 0.9}}"


def seeing(detector_range: int) -> str:
    return CASE.replace("right: [0, 1]}}", DETECTOR.replace("RANGE", str(detector_range)))


def known(space: HypothesisSpace, classes: tuple[EquivalenceClass, ...]) -> set[frozenset[str]]:
    """The classes without hypotheses that have unknown closed locations."""
    names = (frozenset(name for name in one.members if "unknown" not in name) for one in classes)
    return {group for group in names if group}


def grouped(case: CaseStudy) -> set[frozenset[str]]:
    """Pairs whose whole models are equal, for every objective."""
    pairs = list(product(range(case.shape[0]), range(case.shape[1])))
    index = index_of([case.combine(*pair, 0) for pair in pairs])
    models = {
        pair: [model_of(one, index) for one in (case.combine(*pair, o) for o in range(case.shape[2]))]
        for pair in pairs
    }

    def same(first: tuple[int, int], second: tuple[int, int]) -> bool:
        found = [compare(one, other) for one, other in zip(models[first], models[second], strict=True)]
        return all(
            one.same_states and one.max_probability_difference == 0 and one.max_reward_difference == 0
            for one in found
        )

    supports = case.supports
    name = {(e, c): f"{supports.environment.name(e)}.{supports.capability.name(c)}" for e, c in pairs}
    return {frozenset(name[other] for other in pairs if same(pair, other)) for pair in pairs}


def test_for_good_are_those_whose_whole_models_are_equal(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, CASE))
    space = hypothesis_space(case)
    found = alike_for_good(space, prior_belief(space), 100)
    assert known(space, found.dynamics) == grouped(case)
    assert frozenset({"none.lame", "far.full", "far.lame"}) in known(space, found.dynamics)
    assert frozenset(product_names(("shut", "shut_far"), ("full", "lame"))) in known(space, found.dynamics)
    assert sum(one.weight for one in found.dynamics) == pytest.approx(1)
    # r0c2 and r1c2 can both be reached by someone, so no two goals are alike.
    assert all(one.size == 1 for one in found.objective)


def product_names(environments: tuple[str, ...], capabilities: tuple[str, ...]) -> list[str]:
    return [".".join(pair) for pair in product(environments, capabilities)]


@pytest.mark.parametrize(("detector_range", "told"), [(0, False), (1, True)])
def test_a_detector_of_obstacles_tells_them_apart_if_it_can_come_near(
    tmp_path: Path, detector_range: int, told: bool
) -> None:
    case = load_declared_case(write_case(tmp_path, seeing(detector_range)))
    space = hypothesis_space(case)
    found = known(space, alike_for_good(space, prior_belief(space), 100).dynamics)
    assert (frozenset({"none.lame"}) in found) == told
    # What no way leads near stays hidden: from the start, one step sees r0c1 and r1c0 alone.
    assert frozenset(product_names(("shut", "shut_far"), ("full", "lame"))) in found


def test_goals_that_nobody_can_reach_are_alike(tmp_path: Path) -> None:
    text = STRIP.replace("up: [-1, 0], ", "").replace("    up: {move: up, probability: 0.75}\n", "")
    text = text.replace("start: [0, 0]", "start: [1, 0]")
    case = load_declared_case(write_case(tmp_path, text))
    space = hypothesis_space(case)
    objectives = alike_for_good(space, prior_belief(space), 100).objective
    # Without a way up, the cells of the first row are out of reach from r1c0: three goals are one.
    assert sorted(one.size for one in objectives) == [1, 1, 1, 3]


@pytest.mark.parametrize("seed", range(3))
def test_so_far_are_those_with_the_same_likelihood(tmp_path: Path, seed: int) -> None:
    case = load_declared_case(write_case(tmp_path, CASE))
    space = hypothesis_space(case, noise=NOISE)
    seen = trajectory(case.combination("b.full.right"), 6, NOISE, np.random.default_rng(seed))
    belief = inferred(case, space, seen)
    groups: dict[float, set[str]] = {}
    for e, c in product(range(case.shape[0]), range(case.shape[1])):
        # The marginal likelihood of a pair: slips and other odds count as they do in the belief.
        total = (
            weights(belief)[0][list(belief.environments).index(e), c].sum() if e in belief.environments else 0
        )
        if total > 0:
            likelihood = log_likelihood(case.combine(e, c, 0), seen, NOISE, 0.0)
            name = f"{case.supports.environment.name(e)}.{case.supports.capability.name(c)}"
            groups.setdefault(round(likelihood, 6), set()).add(name)
    found = known(space, alike_so_far(space, belief, 100).dynamics)
    assert found == {frozenset(group) for group in groups.values()}


def test_before_anything_is_seen_all_are_alike() -> None:
    space = hypothesis_space(load_declared_case(MODELS / "paper-grid" / "rq1-4.yaml"))
    found = alike_so_far(space, prior_belief(space), 100)
    assert [one.size for one in found.dynamics] == [1002 * 4]
    assert [one.size for one in found.objective] == [81]
    assert len(found.dynamics[0].members) == 10
