"""A simulated system that is met: what it is like, and how strategies meet it.

Axes: P locations, Q modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.concerns.combination import Combination, ResetMode
from merap.families.build import model_of
from merap.learning.run_folder import RunFolder
from merap.mdp.model import Bools, TabularMDP
from merap.shield.learning_shield import ShieldSettings
from merap.shield.safe_optimum import SafeOptimum, safe_optimum
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Supervised, unsafe_of
from merap.strategies.evaluation import Range
from merap.strategies.protocol import reachable_range
from merap.strategies.registry import StrategyContext, make_strategy
from merap.systems.simulated import SimulatedSystem
from merap.systems.slip import slipping_model
from merap.systems.strategy import Strategy


@dataclass(frozen=True)
class Conditions:
    """What makes a system harder to learn from than its model says.

    Attributes:
        reward_noise: standard deviation of the Gaussian noise on the rewards that are seen.
        slip: probability that an action does nothing; policies are scored with it.
        reset: how an episode after the first begins; None: as the case says of the system.
    """

    reward_noise: float = 0.0
    slip: float = 0.0
    reset: ResetMode | None = None


UNDISTURBED = Conditions()


@dataclass(frozen=True, eq=False)
class Encounter:
    """A simulated system that is met, for any strategy to adapt to.

    Attributes:
        system: what is met.
        conditions: what it is like, with a reset mode.
        model: its true model, on the canonical index.
        reachable: what any policy can earn there.
        context: what strategies are made from.
        shield: what strategies are shielded by; None: nothing.
        unsafe: bool [P * Q], where the system's objective says so; None: it says nothing.
        within_shield: what any policy can earn within the shield's threshold; None: there is no shield.
    """

    system: Combination
    conditions: Conditions
    model: TabularMDP
    reachable: Range
    context: StrategyContext
    shield: ShieldSettings | None = None
    unsafe: Bools | None = None
    within_shield: SafeOptimum | None = None

    def strategy(self, name: str, generator: np.random.Generator) -> Strategy:
        """A strategy before any episode, shielded if it is to be; see `registry.make_strategy`."""
        chosen = make_strategy(name, self.context, generator)
        if self.shield is None:
            return chosen
        return ShieldedStrategy(chosen, self.context.hypotheses, self.context.horizon, self.shield)


def encounter(
    run: RunFolder,
    system: Combination,
    *,
    episodes_per_step: int = 35,
    conditions: Conditions = UNDISTURBED,
    shield: ShieldSettings | None = None,
) -> Encounter:
    """Build a system that is met; see `adaptation.adapt`."""
    unsafe = unsafe_of(system)
    given = replace(conditions, reset=conditions.reset or system.reset)
    model = slipping_model(system, given.slip) if given.slip else model_of(system)
    horizon = system.objective.horizon
    context = StrategyContext(run, horizon, system.discount, episodes_per_step, model)
    within = None if shield is None else safe_optimum(system, given.slip, shield.threshold)
    return Encounter(system, given, model, reachable_range(model, horizon), context, shield, unsafe, within)


def met_system(met: Encounter, generator: np.random.Generator) -> SimulatedSystem:
    """What is met, with its detectors."""
    assert met.conditions.reset is not None
    return SimulatedSystem(
        met.system,
        met.context.horizon,
        generator,
        slip=met.conditions.slip,
        noise=met.conditions.reward_noise,
        detect=True,
        reset=met.conditions.reset,
    )


def supervised(met: Encounter, simulated: SimulatedSystem) -> Supervised:
    """The same with its violations counted; none if nothing is unsafe there."""
    nowhere = np.zeros(met.model.num_states - 1, dtype=np.bool_)
    return Supervised(simulated, nowhere if met.unsafe is None else met.unsafe)
