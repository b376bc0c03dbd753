"""Compare evidence about parameters with the models of all hypotheses, enumerated one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice, product

import numpy as np
import pytest

from merap.mdp.model import Floats, Ints
from merap.program.evidence import Evidence, joint
from merap.program.expressions import Value
from merap.program.form import Program
from merap.program.hypotheses import Hypotheses
from tests.support.evidence_enumeration import EnumeratedModel, enumerated
from tests.support.program_enumeration import State

Axes = Sequence[Mapping[str, Sequence[Value]]]
NOISES = np.array([0.1, 2.0])


def models_of(program: Program, axes: Axes) -> dict[tuple[int, ...], EnumeratedModel]:
    """The models of all hypotheses that have one, by their indices."""
    found = {}
    lengths = [len(next(iter(axis.values()))) for axis in axes]
    for index in product(*map(range, lengths)):
        values = {
            name: own[place] for axis, place in zip(axes, index, strict=True) for name, own in axis.items()
        }
        model = enumerated(program, values)
        if model is not None:
            found[index] = model
    return found


def valuation(state: State) -> Ints:
    return np.array([int(value) for value in state])


def check(program: Program, axes: Axes, most: int = 10_000) -> None:
    """Compare every likelihood under every hypothesis that has a model, in up to so many states."""
    hypotheses = Hypotheses(axes)
    evidence, models = Evidence(program, hypotheses), models_of(program, axes)
    states = list(dict.fromkeys(state for model in models.values() for state in model.choices))
    for state in islice(states, most):
        check_state(evidence, models, state, states)


def check_state(
    evidence: Evidence, models: Mapping[tuple[int, ...], EnumeratedModel], state: State, states: list[State]
) -> None:
    program, shape, here = evidence.program, evidence.hypotheses.shape, valuation(state)

    def compare(found: Floats, expected: Mapping[tuple[int, ...], float]) -> None:
        assert not np.isnan(found).any()
        for index, value in expected.items():
            assert found[index] == pytest.approx(value, abs=1e-9), (state, index)

    compare(joint(evidence.start(here), shape), {index: one.start(state) for index, one in models.items()})
    at = {index: one for index, one in models.items() if state in one.choices}
    for names in {frozenset(one.enabled(state)) for one in at.values()}:
        expected = {index: 0 if one.enabled(state) == names else -np.inf for index, one in at.items()}
        compare(joint(evidence.enabled(here, names), shape), expected)
    for name, holds in product(program.labels, (False, True)):
        expected = {index: 0 if one.label(name, state) is holds else -np.inf for index, one in at.items()}
        compare(joint(evidence.label(name, here, holds), shape), expected)
    targets = {target for one in at.values() for _, successors in one.choices[state] for target in successors}
    for target, action in product([*targets, *islice(states, 2)], program.actions):
        expected = {index: one.step(state, action, target) for index, one in at.items()}
        compare(joint(evidence.step(here, action, valuation(target)), shape), expected)
        for name in program.rewards:
            check_reward(evidence, at, name, state, action, target)


def check_reward(
    evidence: Evidence,
    models: Mapping[tuple[int, ...], EnumeratedModel],
    name: str,
    state: State,
    action: str,
    target: State,
) -> None:
    found = evidence.reward(name, valuation(state), action, valuation(target), 0.5, NOISES)
    spread = np.broadcast_to(found, (*evidence.hypotheses.shape, len(NOISES)))
    for index, one in models.items():
        expected = one.reward(name, state, action, target)
        density = (
            np.full(2, -np.inf)
            if expected is None
            else -0.5 * ((0.5 - expected) / NOISES) ** 2 - np.log(NOISES)
        )
        assert spread[index] == pytest.approx(density, abs=1e-9)
