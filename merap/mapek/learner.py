"""The learner: adapts the policy to observations, by one of the strategies.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from merap.mapek.messages import AdaptedPolicy, Monitored
from merap.mdp.model import Bools
from merap.shield.shielded_strategy import Restrictable
from merap.systems.sightings import Transition
from merap.systems.strategy import Revisable, Strategy

StrategyMaker = Callable[[np.random.Generator], Strategy]


class Learner:
    """Updates the policy episode by episode, and starts anew whenever it is told to.

    Args:
        make: makes a strategy before any episode, which begins with the meta policy if it has one.
        generator: draws for the strategies.
        restart: whether a re-planning starts from `make`; else it starts from the adapted policy, and
            doubts the observations of the domain.
    """

    def __init__(
        self,
        make: StrategyMaker,
        generator: np.random.Generator,
        *,
        restart: bool = True,
    ) -> None:
        self._make = make
        self._generator = generator
        self._restart = restart
        self._strategy = self._fresh()
        self._policy: AdaptedPolicy | None = None
        self._updates = self._episodes = 0
        self._begun = self._observed = False

    def _fresh(self) -> Strategy:
        return self._make(self._generator.spawn(1)[0])

    def replan(self) -> None:
        """Adapt anew; the next message says where the system is."""
        if self._restart:
            self._strategy = self._fresh()
        elif isinstance(self._strategy, Revisable):
            self._strategy.revise()
        self._policy = None
        self._updates = self._episodes = 0
        self._begun = self._observed = False

    def relearned(self, make: StrategyMaker) -> None:
        """Begin with another maker of strategies, learned offline meanwhile, from the next re-planning on."""
        self._make = make

    def restrict(self, mask: Bools) -> None:
        """Plan with the actions bool [S, A] alone, if the strategy plans."""
        if isinstance(self._strategy, Restrictable):
            self._strategy.restrict(mask)

    def begin_episode(self) -> None:
        """Begin an episode."""
        self._begun = self._observed = False

    def learn_from(self, monitored: Monitored) -> None:
        """Pass the news on to the strategy, which goes on where the system is seen after a gap."""
        for news in monitored.news:
            if isinstance(news, Transition) and self._begun:
                self._strategy.observe(news.action, news.observation)
                self._observed = True
            elif not news.observation.last:
                time = news.time + isinstance(news, Transition)
                self._strategy.begin(news.observation, time, resumed=self._begun)
                self._begun = True

    def act(self, allowed: Bools) -> int:
        """Return the next action in the state that was seen last, exploration included."""
        return self._strategy.act(allowed)

    def end_episode(self) -> AdaptedPolicy | None:
        """End the episode, and update the policy if it is time; None if it is not."""
        if not self._observed:
            return None
        self._episodes += 1
        if self._episodes < self._strategy.episodes_per_update:
            return None
        self._strategy.update()
        self._episodes = 0
        self._updates += 1
        self._policy = None
        return self.policy()

    def policy(self) -> AdaptedPolicy:
        """Return the policy after the last update; it is made once, since that may take its time."""
        if self._policy is None:
            self._policy = AdaptedPolicy(self._updates, self._strategy.policy(), self._strategy.explain())
        return self._policy
