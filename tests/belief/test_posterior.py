from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.posterior import concern_weights, prior_belief, reweighted, weights
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.update import ObservedStep, observe_detections, observe_step
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.errors import InputError
from merap.mdp.model import Floats
from tests.support.belief_routes import STRIP, Seen, inferred, joint, log_likelihood, trajectory
from tests.support.case_examples import GRAPH, write_case
from tests.support.paths import MODELS

NOISE = 0.3


def normalised(log: Floats) -> Floats:
    shares: Floats = np.exp(log - log.max())
    return np.asarray(shares / shares.sum())


@pytest.mark.parametrize("seed", range(6))
def test_weights_in_the_base_are_those_of_whole_models(tmp_path: Path, seed: int) -> None:
    # Second route: each combination explored. The case has attributes that differ, blocked
    # edges, an automaton, actions with two moves, and ends that read attributes of the successor.
    case = load_declared_case(write_case(tmp_path, GRAPH))
    generator = np.random.default_rng(seed)
    actual = case.combination_at(int(generator.integers(case.size)))
    seen = trajectory(actual, 12, NOISE, generator)
    space = hypothesis_space(case, noise=NOISE)
    environments, capabilities, objectives = case.shape
    found = joint(space, inferred(case, space, seen))[:environments, :capabilities, 0, :objectives]
    expected = np.array(
        [log_likelihood(combination, seen, NOISE, 0.0) for combination in case.combinations()]
    )
    np.testing.assert_allclose(found.ravel() / found.sum(), normalised(expected), atol=1e-9)


# Drifts to the right or down, which may be closed; where it ends tells the goal, but is not seen.
DRIFT = """\
case: drift
discount: 0.9
space:
  grid: {rows: 2, cols: 2, moves: {down: [1, 0], right: [0, 1]}}
environment:
  parameters: {blocked: locations}
  configurations: {free: {blocked: []}, right_blocked: {blocked: [[0, 1]]}}
capability:
  parameters: {no_entry: locations, bias: probability}
  actions:
    stop: {stay: 1}
    drift: {move: right, probability: bias, otherwise: down}
  configurations:
    even: {no_entry: [], bias: 0.5}
    biased: {no_entry: [], bias: 0.9}
    lame: {no_entry: [[1, 0]], bias: 0.5}
objective:
  parameters: {goal: location}
  start: [0, 0]
  horizon: 5
  rewards:
    - {value: -0.5}
  ends_in: {at: goal}
  configurations: {right: {goal: [0, 1]}, low: {goal: [1, 0]}}
"""


def test_what_couples_dynamics_and_objective_is_kept_exactly(tmp_path: Path) -> None:
    """The task ends with the first drift: then one of the ways is open, and the goal is there.

    By hand, too: to the right 1/2, 9/10 and 1/2 where it is free, else never; down 1/2, 1/10, never.
    """
    case = load_declared_case(write_case(tmp_path, DRIFT))
    space = hypothesis_space(case, noise=NOISE)
    ended = Seen((0, 1), ObservedStep(0, 1, space.num_states, -0.5))
    environments, capabilities, objectives = case.shape
    belief = inferred(case, space, [ended])
    found = joint(space, belief)[:environments, :capabilities, 0, :objectives]
    expected = [log_likelihood(combination, [ended], NOISE, 0.0) for combination in case.combinations()]
    np.testing.assert_allclose(found.ravel() / found.sum(), normalised(np.array(expected)), atol=1e-12)
    down = np.array([0.5, 0.1, 0.0])
    by_hand = np.array([[[0.5, 0.9, 0.5], down], [[0.0, 0.0, 0.0], down]]).transpose(0, 2, 1)
    np.testing.assert_allclose(found / found.sum(), by_hand / by_hand.sum(), atol=1e-12)
    # no product of its marginals
    of_dynamics, of_objective = weights(belief)
    product_of = of_dynamics[:environments, :capabilities, 0, np.newaxis] * of_objective.sum(axis=1)
    assert np.abs(product_of[..., :objectives] - joint(space, belief)[:2, :3, 0, :2]).max() > 0.01


def test_an_unlikely_environment_stays_in_play_until_it_is_beyond_recall() -> None:
    """Odds of e^-59 can be made up for by what is seen later, those of e^-61 are given up."""
    space = hypothesis_space(load_declared_case(MODELS / "paper-grid/rq1-4.yaml"))
    prior = prior_belief(space)
    for nats, kept in ((-59.0, True), (-61.0, False)):
        told = np.full_like(prior.dynamics, nats)
        told[0] = 0.0
        likely = prior.dynamics.max(axis=(1, 2))
        told += (likely[0] - likely)[:, np.newaxis, np.newaxis]
        assert (len(reweighted(prior, told, None).environments) > 1) is kept


def closed_everywhere(case: DeclaredCase, closed: tuple[int, ...], goal: int) -> DeclaredCombination:
    """All closed locations as obstacles: whose fault it is makes no difference to a model."""
    template = case.combine(0, 0, 0)
    mask = np.zeros(case.space.num_locations, dtype=np.bool_)
    mask[list(closed)] = True
    objective = case.supports.objective.resolve("any", {"goal": goal})
    return replace(
        template,
        environment=replace(template.environment, blocked=mask),
        capability=replace(template.capability, no_entry=np.zeros_like(mask)),
        objective=objective,
    )


def enumerated(case: DeclaredCase, space: HypothesisSpace, seen: list[Seen]) -> Floats:
    """[E, C, W, O] by enumeration of every set of closed cells under every unknown."""
    cells, known = case.space.num_locations, {}
    goals = [
        int(case.space.location_index[name]) for name in ("r0c2", "r1c2", "r0c0", "r0c1", "r1c0", "r1c1")
    ]
    sets = [
        tuple(np.flatnonzero(mask).tolist()) for mask in product((False, True), repeat=cells) if not mask[0]
    ]
    for closed, w, (o, goal) in product(sets, range(len(space.slips)), enumerate(goals)):
        model = closed_everywhere(case, closed, goal)
        known[closed, w, o] = log_likelihood(model, seen, NOISE, float(space.slips[w]))
    # Under both unknowns a location is open, holds an obstacle or may not be entered: 1 - p to p to p.
    closed_chance = {0: 0.0, 1: space.closed, 2: space.closed, 3: 2 * space.closed / (1 + space.closed)}
    log = np.full((3, 3, len(space.slips), len(goals)), -np.inf)
    for e, c, w, o in np.ndindex(log.shape):
        chance = closed_chance[(e == 2) + 2 * (c == 2)]
        fixed = set(np.flatnonzero(space.blocked[e] | space.no_entry[c]).tolist())
        terms = []
        for extra in sets:
            prior = chance ** len(extra) * (1 - chance) ** (cells - 1 - len(extra))
            closed = tuple(sorted(fixed | set(extra)))
            if prior > 0:
                terms.append(np.log(prior) + known[closed, w, o])
        log[e, c, w, o] = space.prior[e, c, w] + space.objective_prior[o] + np.logaddexp.reduce(terms)
    return normalised(log)


@pytest.mark.parametrize("seed", [0, 1])
def test_weights_outside_the_base_are_those_of_every_set_of_closed_cells(tmp_path: Path, seed: int) -> None:
    case = load_declared_case(write_case(tmp_path, STRIP))
    seen = trajectory(case.system("met"), 14, NOISE, np.random.default_rng(seed))
    space = hypothesis_space(case, Outside(slips=(0.2,), odds=(), closed=0.15), noise=NOISE)
    found = joint(space, inferred(case, space, seen))
    np.testing.assert_allclose(found, enumerated(case, space, seen), atol=1e-9)


def test_the_prior_is_what_is_declared(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, STRIP))
    declared = Outside(environment=0.1, capability=0.2, objective=0.3, slip=0.4, outcomes=0.2)
    space = hypothesis_space(case, declared)
    environment, capability, objective = concern_weights(space, prior_belief(space))
    np.testing.assert_allclose(environment, [0.45, 0.45, 0.1])
    np.testing.assert_allclose(capability, [0.4, 0.4, 0.2])
    np.testing.assert_allclose(objective, [0.35, 0.35, *[0.075] * 4])
    np.testing.assert_allclose(
        weights(prior_belief(space))[0].sum(axis=(0, 1)), [0.4, *[0.1] * 4, *[0.05] * 4]
    )


def test_support_of_the_paper_is_kept_whole() -> None:
    # 27,027 combinations: shared/paper, RQ1-4. Four obstacles of fourteen, three capabilities.
    space = hypothesis_space(load_declared_case(MODELS / "paper-grid" / "rq1-4.yaml"))
    assert (len(space.environment_names) - 1) * (len(space.capability_names) - 1) * 9 == 27_027
    belief = prior_belief(space)
    right = space.case.actions.index("right")
    belief = observe_step(space, belief, ObservedStep(0, right, 1, -0.5))
    environment, _, _ = concern_weights(space, belief)
    open_first = ~space.blocked[:-1, 1]
    # Closed under every environment that has an obstacle there: none of them is left at w < 1.
    assert environment[:-1][~open_first].max() == 0
    assert np.ptp(environment[:-1][open_first]) < 1e-15


def test_an_obstacle_and_no_entry_share_the_blame_as_in_the_prior(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, STRIP.replace("a: {blocked: [[0, 1]]}, ", "")))
    space = hypothesis_space(case, Outside(environment=0.1, capability=0.1, closed=0.2))
    belief = prior_belief(space)
    left = case.actions.index("down")
    for _ in range(20):
        belief = observe_step(space, belief, ObservedStep(0, left, 0, -0.5))
    environment, capability, _ = concern_weights(space, belief)
    # An obstacle at r1c0 or no entry there, equally likely: by symmetry of the prior.
    assert environment[-1] == pytest.approx(capability[-1], rel=1e-6)
    assert environment[-1] > 0.5


def test_an_impossible_observation_is_left_out_and_counted(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, STRIP))
    space = hypothesis_space(case)
    belief = prior_belief(space)
    after = observe_step(space, belief, ObservedStep(0, 0, 5, -0.5))
    assert after.unexplained == 1
    np.testing.assert_array_equal(after.dynamics, belief.dynamics)


def test_noise_is_estimated(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, STRIP))
    space = hypothesis_space(case)
    generator = np.random.default_rng(0)
    belief = prior_belief(space)
    sigma = float(space.noises[3])
    for _ in range(200):
        reward = -0.5 + sigma * float(generator.normal())
        belief = observe_step(space, belief, ObservedStep(0, 0, 0, reward))
    assert weights(belief)[1].sum(axis=0)[3] > 0.95


def test_a_detector_of_obstacles_says_which_concern_it_is() -> None:
    case = load_declared_case(MODELS / "running-example")
    space = hypothesis_space(case)
    belief = observe_detections(space, prior_belief(space), {"lidar": {"B": True}})
    environment, _, _ = concern_weights(space, belief)
    # Bayes' rule by hand: accuracy 0.95; B is blocked in two of three environments, under the
    # unknown one with the declared chance of a closed location.
    chance = space.closed
    likelihood = np.array([0.95, 0.05, 0.95, 0.95 * chance + 0.05 * (1 - chance)])
    expected = likelihood * np.array([0.95 / 3] * 3 + [0.05])
    # With the capability unknown too, an obstacle is one of three things a location may be.
    both = chance / (1 + chance)
    joint_last = 0.05 * (0.95 * likelihood[3] + 0.05 * (0.95 * both + 0.05 * (1 - both)))
    expected[3] = joint_last
    np.testing.assert_allclose(environment, expected / expected.sum(), rtol=1e-9)


@pytest.mark.parametrize("detections", [{"radar": {"B": True}}, {"lidar": {"Z": True}}, {"lidar": True}])
def test_detections_that_can_not_be_read_are_refused(detections: dict[str, object]) -> None:
    space = hypothesis_space(load_declared_case(MODELS / "running-example"))
    with pytest.raises(InputError):
        observe_detections(space, prior_belief(space), detections)


@pytest.mark.parametrize(
    "wrong",
    [
        {"environment": 0.0},
        {"slip": 1.0},
        {"slips": ()},
        {"slips": (1.0,)},
        {"odds": (0.0,)},
        {"slip": 0.5, "outcomes": 0.5},
    ],
)
def test_a_prior_that_is_none_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Outside(**wrong)  # type: ignore[arg-type]
