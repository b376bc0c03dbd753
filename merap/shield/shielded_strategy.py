"""Any strategy behind a shield: its actions and its policy are those that the shield leaves."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from merap.belief.space import HypothesisSpace
from merap.mdp.model import Bools, Floats
from merap.shield.learning_shield import LearningShield, ShieldSettings
from merap.shield.shield import ShieldReport
from merap.systems.interface import Observation
from merap.systems.strategy import Strategy


@runtime_checkable
class Restrictable(Protocol):
    """A strategy that plans, and does it better if it knows what will not be allowed."""

    def restrict(self, mask: Bools) -> None:
        """Plan with the actions bool [S, A] alone; a row without any is not restricted."""


class ShieldedStrategy:
    """A strategy that acts, explores and is executed within a shield; see `strategy.Strategy`.

    The order of a step: the strategy and the shield's own belief learn from what was seen, then the
    shield solves again if other models are credible now, then the strategy may act.

    Args:
        strategy: what adapts.
        space: the hypotheses of the case, over which the shield keeps a belief of its own.
        horizon: T, for the mask of the policy.
        settings: of the shield.

    Raises:
        InputError: nothing is declared unsafe and there is no prior on hazards, or a number is out of
            range.
    """

    def __init__(
        self,
        strategy: Strategy,
        space: HypothesisSpace,
        horizon: int,
        settings: ShieldSettings,
    ) -> None:
        self._strategy = strategy
        self._shield = LearningShield(space, horizon, settings)
        self._steps = 0
        self._restrict()

    @property
    def episodes_per_update(self) -> int:
        """That of the strategy."""
        return self._strategy.episodes_per_update

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """An episode begins; for one with gaps see `loop.loop_shield`, which is told of all actions."""
        assert time == 0, "the shield was not told of the steps before"
        self._steps = 0
        self._shield.begin()
        self._shield.sighted(0, observation)
        self._refresh()
        self._strategy.begin(observation)

    def act(self, allowed: Bools) -> int:
        """The strategy's next action, among those within the budget."""
        return self._strategy.act(self._shield.allowed(allowed))

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        self._steps += 1
        self._shield.took(action)
        self._shield.stepped(self._steps, action, observation)
        self._refresh()
        self._strategy.observe(action, observation)

    def update(self) -> None:
        """The strategy learns from its episodes."""
        self._strategy.update()

    def policy(self) -> Floats:
        """The strategy's policy within a mask that keeps the threshold; see `policy`."""
        return self._shield.masked(self._strategy.policy())

    def explain(self) -> tuple[str, ...]:
        """What the strategy says, and what the shield did."""
        done = self.report()
        line = (
            f"shield at {done.threshold:g}: {done.withheld} actions withheld in {done.steps} steps, "
            f"{done.fallbacks} steps with nothing within the budget; least risk from the start "
            f"{self._shield.least_risk:.3g}"
        )
        unexplained = self._shield.belief.unexplained
        if unexplained:
            line += f"; {unexplained} observations that no hypothesis explains, so that nothing is promised"
        return (*self._strategy.explain(), line)

    def report(self) -> ShieldReport:
        """What the shield has done so far."""
        return self._shield.report()

    def _refresh(self) -> None:
        if self._shield.refresh():
            self._restrict()

    def _restrict(self) -> None:
        """A planner keeps to what an episode's whole budget could allow in one step."""
        if isinstance(self._strategy, Restrictable):
            self._strategy.restrict(self._shield.mask)
