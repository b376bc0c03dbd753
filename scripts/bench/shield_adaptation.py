"""A strategy that adapts within a shield, as `merap adapt --shield` has it: violations, goals and returns.

Beside `shield_exploration`, whose robots know the models of a base and no others, this is the product: the
shield keeps a belief over all hypotheses of the case, what lies outside its base included.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import DeclaredCase
from merap.mapek.managers import RandomStrategy
from merap.shield.learning_shield import ShieldSettings
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Safety, Supervised, total
from merap.strategies.protocol import episode
from merap.systems.simulated import SimulatedSystem
from merap.systems.strategy import Strategy
from scripts.bench.shield_exploration import rate_limit
from scripts.bench.shield_quality import Setting

RANDOM = "any allowed action"
STRATEGIES = (RANDOM, "belief")
# What is met with a shield and without. To explore at `island` takes a threshold above 0.1, its least risk.
ADAPTING = (
    Setting("running-example", "c_blocked.speed_high.g1", 0.0),
    Setting("hazard-grid", "met", 0.0),
    Setting("hazard-grid", "island", 0.3),
)
# Episodes of one adaptation, after which the next begins with what is known beforehand.
EPISODES = 10


def adaptation_figures(
    case: DeclaredCase,
    system: str,
    strategy: str,
    threshold: float | None,
    episodes: int = 200,
    seed: int = 0,
) -> dict[str, Any]:
    """Return a row of adaptations of `EPISODES` episodes each; equal seeds for every threshold.

    Args:
        case: the case.
        system: one of its systems or combinations, whose objective says what is unsafe.
        strategy: one of `STRATEGIES`.
        threshold: lambda; None: no shield.
        episodes: of all adaptations together.
        seed: of everything random.
    """
    begin = time.perf_counter()
    space = hypothesis_space(case)
    generators = np.random.default_rng(seed).spawn(max(1, episodes // EPISODES))
    found, returns = [], []
    for generator in generators:
        safety, earned = _adapted(case, space, system, strategy, threshold, generator)
        found.append(safety)
        returns += earned
    sums = total(found)
    return {
        "case": case.name,
        "system": system,
        "strategy": strategy,
        "threshold": threshold,
        **{name: sums[name] for name in ("episodes", "violations", "completed")},
        "violation_limit": rate_limit(sums["violations"], sums["episodes"]),
        "fallback_steps": None if sums["shield"] is None else sums["shield"]["fallbacks"],
        "mean_return": float(np.mean(returns)),
        "seconds": time.perf_counter() - begin,
    }


def _adapted(
    case: DeclaredCase,
    space: HypothesisSpace,
    system: str,
    strategy: str,
    threshold: float | None,
    generator: np.random.Generator,
) -> tuple[Safety, list[float]]:
    combination = case.system(system)
    horizon = combination.objective.horizon
    of_system, of_strategy = generator.spawn(2)
    supervised = Supervised(SimulatedSystem(combination, horizon, of_system, detect=True))
    acting: Strategy
    if strategy == RANDOM:
        acting = RandomStrategy((space.num_states + 1, len(space.actions)), of_strategy)
    else:
        acting = BeliefStrategy(space, horizon, of_strategy)
    shielded = None
    if threshold is not None:
        acting = shielded = ShieldedStrategy(acting, space, horizon, ShieldSettings(threshold))
    returns = []
    for _ in range(EPISODES):
        returns.append(episode(supervised, acting))
        acting.update()
    return supervised.safety(None if shielded is None else shielded.report()), returns
