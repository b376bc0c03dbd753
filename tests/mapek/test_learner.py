from __future__ import annotations

import numpy as np
import pytest

from merap.mapek.learner import Learner
from merap.systems.sightings import Sighting, Transition
from tests.support.loop_examples import Told, monitored, seen

START = Sighting(0, seen(0, 0), 0)
RIGHT = Transition(0, 0, 4, 1, seen(0, 1))
ENDED = Transition(0, 1, 0, 81, seen(-1, -1, 10.0, ended=True))


class Remembering(Told):
    """A strategy that remembers the domain."""

    def revise(self) -> None:
        self.calls.append("revise")


def learner(made: list[Told], per_update: int = 1, *, restart: bool = True) -> Learner:
    def make(generator: np.random.Generator) -> Told:
        made.append(Told(episodes_per_update=per_update))
        return made[-1]

    return Learner(make, np.random.default_rng(0), restart=restart)


def episode(learning: Learner) -> int | None:
    """A step to the right, and the end; the number of the update, if there was one."""
    learning.begin_episode()
    for news in (START, RIGHT, ENDED):
        learning.learn_from(monitored(0, [news]))
    policy = learning.end_episode()
    return None if policy is None else policy.update


def test_the_strategy_is_told_the_episode_and_updated_after_it() -> None:
    made: list[Told] = []
    learning = learner(made)
    assert episode(learning) == 1
    assert made[0].calls == ["begin [0, 0]", "4 to [0, 1]", "0 to [-1, -1]", "update"]


def test_an_update_takes_as_many_episodes_as_the_strategy_wants() -> None:
    learning = learner([], per_update=3)
    assert [episode(learning) for _ in range(7)] == [None, None, 1, None, None, 2, None]


def test_replanning_starts_from_a_fresh_strategy() -> None:
    made: list[Told] = []
    learning = learner(made)
    assert [episode(learning), episode(learning)] == [1, 2]
    learning.replan()
    assert len(made) == 2
    assert made[1].calls == []
    assert episode(learning) == 1


def test_replanning_may_start_from_the_adapted_policy() -> None:
    made: list[Told] = []
    learning = learner(made, restart=False)
    episode(learning)
    learning.replan()
    assert len(made) == 1
    assert episode(learning) == 1


def test_an_adapted_policy_is_kept_but_what_was_seen_of_the_domain_is_doubted() -> None:
    made: list[Remembering] = []

    def make(generator: np.random.Generator) -> Remembering:
        made.append(Remembering())
        return made[-1]

    for restart in (False, True):
        made.clear()
        learning = Learner(make, np.random.default_rng(0), restart=restart)
        episode(learning)
        learning.replan()
        assert ["revise" in one.calls for one in made] == ([False, False] if restart else [True])


@pytest.mark.parametrize("restart", [True, False])
def test_a_replanning_amid_an_episode_begins_where_the_system_is(restart: bool) -> None:
    """Nothing is resumed: what was seen before it is dropped with the strategy, or by it."""
    made: list[Told] = []
    learning = learner(made, restart=restart)
    learning.begin_episode()
    learning.learn_from(monitored(0, [START]))
    learning.replan()
    learning.learn_from(monitored(1, [RIGHT]))
    assert made[-1].calls[-1] == "begin at 1 in [0, 1]"


def test_after_a_gap_the_strategy_goes_on_at_the_time_that_it_is() -> None:
    made: list[Told] = []
    learning = learner(made)
    learning.begin_episode()
    for news in (START, Sighting(20, seen(2, 2), 5), Transition(5, 20, 4, 21, seen(2, 3))):
        learning.learn_from(monitored(None, [news]))
    assert made[0].calls == ["begin [0, 0]", "begin resumed at 5 in [2, 2]", "4 to [2, 3]"]


def test_an_episode_whose_beginning_was_not_seen_does_not_go_on_with_the_one_before() -> None:
    made: list[Told] = []
    learning = learner(made, per_update=2)
    learning.begin_episode()
    learning.learn_from(monitored(0, [START]))
    learning.begin_episode()
    learning.learn_from(monitored(20, [Sighting(20, seen(2, 2), 3)]))
    assert made[0].calls == ["begin [0, 0]", "begin at 3 in [2, 2]"]


def test_an_episode_of_which_nothing_was_seen_is_none() -> None:
    made: list[Told] = []
    learning = learner(made)
    learning.begin_episode()
    learning.learn_from(monitored(81, [Sighting(81, seen(-1, -1, ended=True), 2)], last=True))
    assert learning.end_episode() is None
    assert made[0].calls == []


def test_every_strategy_draws_on_its_own() -> None:
    drawn: list[float] = []

    def make(generator: np.random.Generator) -> Told:
        drawn.append(generator.random())
        return Told()

    learning = Learner(make, np.random.default_rng(0))
    learning.replan()
    assert len(set(drawn)) == 2
