"""MDPs of explored programs, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.errors import ModelError
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.program.form import Process, Program, integer
from tests.support.programs import ONE_COIN, command, outcome, start


def leaps(size: int) -> Program:
    """0, size and 2 * size, of 2 * size + 1 values: the more, the further codes are apart."""
    commands = (
        command("leap", f"x < {2 * size}", [outcome("0.5", x=f"x + {size}"), outcome("0.5", x="0")]),
        command("leap", f"x > {size}", [outcome("1", x="0")]),
        command("rest", "true", [outcome("1")]),
    )
    return Program(
        "leaps", (Process("p", "environment", (integer("x", 0, 2 * size),), commands, start(x="0")),)
    )


@pytest.mark.parametrize("size", [1, 2, 5_000, 100_000_000])
def test_the_model_is_the_same_however_far_codes_are_apart(size: int) -> None:
    mdp = tabular(leaps(size), explore(leaps(size)))
    assert mdp.valuations.tolist() == [[0], [size], [2 * size]]
    assert mdp.action_names == ("leap", "rest")
    assert mdp.reachable.all()
    assert mdp.branch_target.tolist() == [0, 1, 0, 0, 2, 1, 0, 2]
    assert mdp.branch_prob.tolist() == [0.5, 0.5, 1, 0.5, 0.5, 1, 1, 1]


def test_first_rewards_are_those_of_actions() -> None:
    mdp = tabular(ONE_COIN, explore(ONE_COIN), reward="steps")
    names = np.array(mdp.action_names)[mdp.choice_action]
    assert dict(zip(names.tolist(), mdp.choice_reward.tolist(), strict=True)) == {"toss": 1.0, "rest": 0.0}
    # 0.1 * 3 <= 0.3, which doubles get wrong
    assert mdp.labels["goal"].tolist() == [False, False, False, True]


def test_two_commands_of_an_action_that_are_enabled_together_are_refused() -> None:
    again = command("leap", "x = 2", [outcome("1", x="1")])
    (process,) = leaps(1).processes
    doubled = replace(leaps(1), processes=(replace(process, commands=(*process.commands, again)),))
    with pytest.raises(ModelError, match=r"^leaps: two commands of leap are enabled in state \(x=2\)$"):
        tabular(doubled, explore(doubled))
