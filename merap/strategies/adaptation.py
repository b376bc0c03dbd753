"""The online phase: adapt to a system that is met, by one of several strategies.

Axes: B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias

import numpy as np

from merap.concerns.combination import Combination
from merap.errors import InputError
from merap.learning.run_folder import RunFolder
from merap.learning.threads import one_thread
from merap.mdp.model import Floats, TabularMDP
from merap.shield.learning_shield import ShieldSettings
from merap.shield.safe_optimum import SafeOptimum
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Safety, total
from merap.strategies.evaluation import Range, Run, as_dict, judged, summary
from merap.strategies.ground_truth import (
    UNDISTURBED,
    Conditions,
    Encounter,
    encounter,
    met_system,
    supervised,
)
from merap.strategies.protocol import adaptation, evaluator, executed
from merap.strategies.registry import ALL, GRADIENT, PRETRAINED, parse_strategy
from merap.systems.strategy import Strategy

OnStep = Callable[[], None]
Reasons: TypeAlias = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Adaptation:
    """Several adaptations to one system, which differ in their seed.

    Attributes:
        system: its name.
        conditions: what it was like.
        strategy: how it was adapted to.
        reachable: what any policy can earn there.
        runs: one for each seed.
        before: float64 [S, A + 1] or [T, S, A + 1], the policy of the first run before any
            episode; the last action is `end`.
        after: likewise, after its last update.
        reasons: of each run, what the strategy said before any episode and after each update.
        model: the system's true model, on the canonical index.
        safety: of each run; empty if the system's objective declares nothing unsafe and there is no
            shield.
        within_shield: what any policy can earn there within the shield's threshold; None: there is no shield.
    """

    system: str
    conditions: Conditions
    strategy: str
    reachable: Range
    runs: tuple[Run, ...]
    before: Floats = field(repr=False)
    after: Floats = field(repr=False)
    reasons: tuple[Reasons, ...] = field(repr=False)
    model: TabularMDP = field(repr=False)
    safety: tuple[Safety, ...] = ()
    within_shield: SafeOptimum | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "system": self.system,
            **asdict(self.conditions),
            "strategy": self.strategy,
            "optimum": self.reachable.optimum,
            "worst": self.reachable.worst,
            "safe_optimum": None if self.within_shield is None else self.within_shield.value,
            "safely_completed": None if self.within_shield is None else self.within_shield.completed,
            "runs": [as_dict(run) for run in self.runs],
            "reasons": [[list(lines) for lines in of_run] for of_run in self.reasons],
            "summary": summary(self.runs),
            "safety": {"total": total(self.safety), "runs": [one.as_dict() for one in self.safety]}
            if self.safety
            else None,
        }


def adapt(
    run: RunFolder,
    system: Combination,
    *,
    strategy: str = GRADIENT,
    episodes_per_step: int = 35,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: Sequence[int] = (0,),
    conditions: Conditions = UNDISTURBED,
    shield: ShieldSettings | None = None,
    on_step: OnStep = lambda: None,
) -> Adaptation:
    """Adapt to a simulated system, once for each seed.

    What a seed gives does not depend on the others.

    Args:
        run: a finished training run.
        system: an online system or a combination of the run's case.
        strategy: one of `registry.STRATEGIES`.
        episodes_per_step: B, of strategies that take gradient steps.
        steps: policy updates.
        max_episodes: real episodes at most, in place of `steps`.
        seeds: of the episodes.
        conditions: what the system is like.
        shield: keeps what is done, explored and learned within a threshold; None: nothing does.
        on_step: called after each policy update of each seed.

    Raises:
        InputError: the run is not finished, there is no seed, no such strategy, nothing to shield from, a
            condition is out of range, the episodes are too few for one policy update, or the system can't
            begin another one.
    """
    require_adaptable(strategy, seeds)
    met = encounter(run, system, episodes_per_step=episodes_per_step, conditions=conditions, shield=shield)
    return adapt_to(met, strategy, steps=steps, max_episodes=max_episodes, seeds=seeds, on_step=on_step)


def require_adaptable(strategy: str, seeds: Sequence[int]) -> None:
    """Refuse what can't be adapted with, before any work is done.

    Raises:
        InputError: there is no seed, or no such strategy.
    """
    if not seeds:
        raise InputError("there is no seed to adapt with")
    if parse_strategy(strategy) == (PRETRAINED, ALL):
        raise InputError(f"{strategy!r} is one policy for each task; adapt with one of them")


def adapt_to(
    met: Encounter,
    strategy: str,
    *,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: Sequence[int] = (0,),
    on_step: OnStep = lambda: None,
) -> Adaptation:
    """Adapt to what is met; see `adapt`."""
    require_adaptable(strategy, seeds)
    found: list[tuple[Run, Floats, Floats, Safety, Reasons]] = []
    with one_thread():
        for seed in seeds:
            of_system, of_strategy = np.random.default_rng(seed).spawn(2)
            chosen = met.strategy(strategy, of_strategy)
            limit = steps * chosen.episodes_per_update if max_episodes is None else max_episodes
            if max_episodes is not None and limit < chosen.episodes_per_update:
                raise InputError(
                    f"{strategy} takes {chosen.episodes_per_update} real episodes for a policy update; "
                    f"{limit} are too few"
                )
            found.append(_followed(seed, met, chosen, of_system, limit, on_step))
    runs, before, after, safety, reasons = zip(*found, strict=True)
    return Adaptation(
        system=met.system.name,
        conditions=met.conditions,
        strategy=strategy,
        reachable=met.reachable,
        runs=runs,
        before=before[0],
        after=after[0],
        reasons=reasons,
        model=met.model,
        safety=safety if met.shield is not None or met.unsafe is not None else (),
        within_shield=met.within_shield,
    )


def _followed(
    seed: int,
    met: Encounter,
    strategy: Strategy,
    generator: np.random.Generator,
    max_episodes: int,
    on_step: OnStep,
) -> tuple[Run, Floats, Floats, Safety, Reasons]:
    """One adaptation: the policies before and after, what happened, and why, row by row."""
    simulated = met_system(met, generator)
    counted = supervised(met, simulated)
    before = executed(met.model, strategy.policy())
    rows, reasons = [], []
    for row in adaptation(counted, strategy, evaluator(met.model, met.context.horizon), max_episodes):
        rows.append(row)
        reasons.append(strategy.explain())
        if row.step:
            on_step()
    run = judged(seed, rows, met.reachable, simulated.steps_back)
    safety = counted.safety(strategy.report() if isinstance(strategy, ShieldedStrategy) else None)
    return run, before, executed(met.model, strategy.policy()), safety, tuple(reasons)


@dataclass(frozen=True, eq=False)
class Spread:
    """How much it matters for which combination a policy was learned that is not adapted.

    Attributes:
        values: combination -> exact value of its policy on the true model, best first.
        best: the best of them played, as `pretrained:<combination>`.
        median: likewise; of an even number the better one.
        worst: likewise.
    """

    values: Mapping[str, float]
    best: Adaptation
    median: Adaptation
    worst: Adaptation

    @property
    def shown(self) -> tuple[Adaptation, ...]:
        """Best, median, worst."""
        return self.best, self.median, self.worst

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "system": self.best.system,
            **asdict(self.best.conditions),
            "strategy": f"{PRETRAINED}:{ALL}",
            "optimum": self.best.reachable.optimum,
            "worst": self.best.reachable.worst,
            "values": dict(self.values),
            "best_policy": self.best.as_dict(),
            "median_policy": self.median.as_dict(),
            "worst_policy": self.worst.as_dict(),
        }


def spread_of_pretrained(
    met: Encounter,
    *,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: Sequence[int] = (0,),
    on_step: OnStep = lambda: None,
) -> Spread:
    """Play the policies learned for the base's combinations that are best, median and worst here.

    Which those are is known from the true model: this shows the range of a baseline and is no
    way to adapt. Arguments as those of `adapt`.
    """
    values = values_of_pretrained(met)
    best, median, worst = (
        adapt_to(
            met,
            f"{PRETRAINED}:{name}",
            steps=steps,
            max_episodes=max_episodes,
            seeds=seeds,
            on_step=on_step,
        )
        for name in best_median_worst(values)
    )
    return Spread(values, best, median, worst)


def values_of_pretrained(met: Encounter) -> dict[str, float]:
    """Combination of the run's base -> exact value of the policy learned for it, here; best first."""
    names = met.context.run.names
    evaluate = evaluator(met.model, met.context.horizon)
    policies = met.context.pretrained(names)
    values = {name: evaluate(policy) for name, policy in zip(names, policies, strict=True)}
    return dict(sorted(values.items(), key=lambda item: -item[1]))


def best_median_worst(values: Mapping[str, float]) -> tuple[str, str, str]:
    """Of values ranked best first; of an even number the better one is the median."""
    ranked = list(values)
    return ranked[0], ranked[(len(ranked) - 1) // 2], ranked[-1]
