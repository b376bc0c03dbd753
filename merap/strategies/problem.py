"""Set an adaptation problem: a simulated system, its conditions, and the means of the strategy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.concerns.arguments import as_number
from merap.concerns.combination import Combination, ResetMode
from merap.mdp.short_repr import ShortRepr
from merap.runs.run_folder import RunFolder
from merap.shield.learning_shield import ShieldSettings
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Supervised
from merap.strategies.ground_truth import GroundTruth, ground_truth
from merap.strategies.registry import StrategyContext, make_strategy
from merap.systems.simulated import SimulatedSystem
from merap.systems.strategy import Strategy


@dataclass(frozen=True)
class Conditions:
    """Conditions under which a system is harder to learn from than its model says.

    Attributes:
        reward_noise: standard deviation of the Gaussian noise on the rewards that are seen.
        slip: probability that an action does nothing; policies are scored with it.
        reset: how an episode after the first begins; None: as the case says of the system.

    Raises:
        InputError: a condition is no number.
    """

    reward_noise: float = 0.0
    slip: float = 0.0
    reset: ResetMode | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "reward_noise", as_number(self.reward_noise, "reward_noise"))
        object.__setattr__(self, "slip", as_number(self.slip, "slip"))


UNDISTURBED = Conditions()


@dataclass(frozen=True, eq=False, repr=False)
class AdaptationProblem(ShortRepr):
    """A simulated system for any strategy to adapt to.

    Attributes:
        truth: the system as it really is; strategies never see it.
        conditions: conditions of its episodes, with a reset mode.
        context: from which strategies are made.
        shield: shield of the strategies; None: they are not shielded.
    """

    truth: GroundTruth
    conditions: Conditions
    context: StrategyContext
    shield: ShieldSettings | None = None

    def strategy(self, name: str, generator: np.random.Generator) -> Strategy:
        """Make a strategy before any episode, shielded if there is a shield; see `registry.make_strategy`."""
        chosen = make_strategy(name, self.context, generator)
        if self.shield is None:
            return chosen
        return ShieldedStrategy(chosen, self.context.hypotheses, self.context.horizon, self.shield)

    def simulated(self, generator: np.random.Generator) -> SimulatedSystem:
        """Make the system, with its detectors."""
        assert self.conditions.reset is not None
        return SimulatedSystem(
            self.truth.system,
            self.context.horizon,
            generator,
            slip=self.conditions.slip,
            noise=self.conditions.reward_noise,
            detect=True,
            reset=self.conditions.reset,
        )

    def supervised(self, simulated: SimulatedSystem) -> Supervised:
        """Count the violations of the simulated system; there are none if nothing is unsafe there."""
        return Supervised(simulated)


def adaptation_problem(
    run: RunFolder,
    system: Combination,
    *,
    episodes_per_step: int = 35,
    conditions: Conditions = UNDISTURBED,
    shield: ShieldSettings | None = None,
) -> AdaptationProblem:
    """Make the problem of adapting to a system; see `adaptation.adapt`."""
    given = replace(conditions, reset=conditions.reset or system.reset)
    threshold = None if shield is None else shield.threshold
    truth = ground_truth(system, given.slip, threshold)
    whole = truth.whole
    context = StrategyContext(run, truth.horizon, system.discount, episodes_per_step, whole, (whole,))
    return AdaptationProblem(truth, given, context, shield)
