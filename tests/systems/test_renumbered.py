from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from merap.errors import InputError
from merap.systems.interface import Observation
from merap.systems.renumbered import RenumberedSystem


class Counter:
    """Says what it was told: the first variable counts steps, the second is the last action."""

    actions = ("a", "b", "c")

    def __init__(self, taken: int | None = None) -> None:
        self.steps, self.taken = 0, taken

    def reset(self) -> Observation:
        self.steps = 0
        return self.seen(9)

    def step(self, action: int) -> Observation:
        self.steps += 1
        return self.seen(action)

    def seen(self, action: int) -> Observation:
        over = self.steps == 2
        return Observation(
            valuation=np.array([self.steps, action]),
            enabled=np.array([True, False, False]),
            reward=float(action),
            continuation=float(not over),
            truncated=False,
            taken=self.taken,
        )


def renumbered(
    system: Counter,
    actions: Sequence[str] = ("c", "a", "b"),
    variables: Sequence[str] = ("act", "count", "mode"),
) -> RenumberedSystem:
    return RenumberedSystem(
        system, ("count", "act"), actions=actions, variables=variables, constants={"mode": 5}
    )


def test_actions_and_variables_have_the_order_of_the_manager() -> None:
    system = renumbered(Counter())
    assert system.actions == ("c", "a", "b")
    assert system.reset().valuation.tolist() == [9, 0, 5]
    seen = system.step(0)  # c, their action 2
    assert (seen.reward, seen.valuation.tolist()) == (2.0, [2, 1, 5])
    assert seen.enabled.tolist() == [False, True, False]
    assert system.step(1).valuation.tolist() == [0, 2, 5]


def test_what_was_taken_instead_is_numbered_too() -> None:
    system = renumbered(Counter(taken=1))
    system.reset()
    assert system.step(0).taken == 2


@pytest.mark.parametrize(
    ("actions", "variables", "message"),
    [
        (("a", "b"), ("act", "count", "mode"), "it has the actions a, b, c; expected a, b"),
        (("a", "b", "c"), ("act", "row", "mode"), "it has the variables count, act; expected act, row"),
    ],
)
def test_a_system_of_other_names_is_refused(
    actions: Sequence[str], variables: Sequence[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        renumbered(Counter(), actions, variables)


def test_there_is_no_other_action() -> None:
    with pytest.raises(InputError, match="there is no action 3, only 0 to 2"):
        renumbered(Counter()).step(3)
