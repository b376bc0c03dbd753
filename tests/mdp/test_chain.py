"""Induced Markov chains, against Storm and by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import stormpy

from merap.mdp.chain import induced_chain, write_induced_chain
from merap.mdp.evaluation import expected_return
from merap.mdp.planning import optimum
from merap.mdp.umb import read_umb
from tests.support.mdp_examples import make_mdp, puterman_two_states, random_mdp
from tests.support.storm_runs import storm_values


@pytest.mark.parametrize("seed", range(5))
def test_storm_values_an_induced_chain(tmp_path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    mdp = random_mdp(generator)
    policy = np.where(mdp.enabled, generator.random(mdp.enabled.shape), 0.0)
    policy /= policy.sum(axis=1, keepdims=True)
    write_induced_chain(mdp, policy, str(tmp_path / "chain.umb"))
    model = stormpy.build_model_from_umb(str(tmp_path / "chain.umb"))
    assert "DTMC" in str(model)
    assert model.nr_choices == model.nr_states
    values = storm_values(tmp_path / "chain.umb", 'R{"objective"}=? [C<=7]')
    start = int(next(iter(model.initial_states)))
    assert values[start] == pytest.approx(expected_return(mdp, policy, 7), abs=1e-9)
    chain = read_umb(tmp_path / "chain.umb")
    assert optimum(chain, 7) == pytest.approx(values[start], abs=1e-9)


def test_an_induced_chain_by_hand() -> None:
    mdp = puterman_two_states()
    chain = induced_chain(mdp, np.array([[0.5, 0.5, 0], [0, 0, 1.0]]))
    assert chain.transitions.toarray().tolist() == [[0.25, 0.75], [0, 1]]
    assert chain.choice_reward.tolist() == [7.5, -1]
    never_left = induced_chain(
        make_mdp(
            {
                (0,): {"stay": (1.0, {(0,): 1.0}), "go": (2.0, {(1,): 1.0})},
                (1,): {"go": (0.0, {(0,): 1.0})},
                (2,): {"go": (0.0, {(0,): 1.0})},
            }
        ),
        np.array([[1.0, 0.0], [0.0, 1.0], [0.3, 0.3]]),
    )
    assert never_left.reachable.tolist() == [True, False, False]
    assert never_left.state_to_choice.tolist() == [0, 1, 2, 2]
    assert never_left.transitions.toarray().tolist() == [[1, 0, 0], [1, 0, 0]]
