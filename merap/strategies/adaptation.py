"""The online phase: adapt to a simulated system, by one of several strategies.

Axes: B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from merap.concerns.arguments import as_count, as_instance, as_number, as_seeds, as_text
from merap.concerns.combination import Combination
from merap.errors import InputError, warn_of
from merap.families.build import cut_off_warnings
from merap.families.lookup import as_system
from merap.learning.threads import one_thread
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.short_repr import ShortRepr
from merap.runs.run_folder import RunFolder, as_run
from merap.shield.learning_shield import ShieldSettings
from merap.shield.safe_optimum import SafeOptimum
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Safety, total
from merap.strategies.evaluation import Range, Run, as_dict, executed, judged, summary
from merap.strategies.problem import UNDISTURBED, AdaptationProblem, Conditions, adaptation_problem
from merap.strategies.protocol import adaptation_rows
from merap.strategies.registry import ALL, PRETRAINED, default_strategy, parse_strategy
from merap.systems.strategy import Strategy

OnStep = Callable[[], None]
Reasons: TypeAlias = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False, repr=False)
class Adaptation(ShortRepr):
    """Several adaptations to one system, which differ in their seed.

    Attributes:
        system: its name.
        conditions: conditions of its episodes.
        strategy: name of the strategy.
        reachable: returns of the best and the worst policy there.
        runs: one for each seed.
        before: float64 [S, A + 1] or [T, S, A + 1], the policy of the first run before any
            episode; the last action is `end`.
        after: the same after its last update.
        reasons: explanations of the strategy in each run, before any episode and after each update.
        model: the system's true model, on the index of the policies.
        safety: safety of each run; empty if the system's objective declares nothing unsafe and there is no
            shield.
        within_shield: best return and chance within the shield's threshold; None: there is no shield.
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
        """Return the results as JSON has them."""
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
    run: RunFolder | str | PathLike[str],
    system: Combination | str,
    *,
    strategy: str | None = None,
    episodes_per_step: int = 35,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: int | str | Iterable[int] = 0,
    conditions: Conditions = UNDISTURBED,
    shield: ShieldSettings | float | None = None,
    on_step: OnStep = lambda: None,
) -> Adaptation:
    """Adapt to a simulated system, once for each seed.

    The result of a seed does not depend on the other seeds.

    Args:
        run: a finished training run, or its folder.
        system: an online system or a combination of the run's case, or its name.
        strategy: one of `registry.STRATEGIES`; None: `belief`, or `gradient` where no belief is kept.
        episodes_per_step: B, of strategies that take gradient steps.
        steps: policy updates.
        max_episodes: real episodes at most, in place of `steps`.
        seeds: seeds of the episodes: one, several, or a text such as `0:5`.
        conditions: conditions of its episodes.
        shield: keeps actions, exploration and the learned policy within a threshold, which alone may be
            given; None: there is none.
        on_step: called after each policy update of each seed.

    Raises:
        InputError: the run is not finished, there is no seed, no such strategy, nothing to shield from, a
            condition is out of range, the episodes are too few for one policy update, or the system can't
            begin another one.
    """
    chosen = as_seeds(seeds)
    if strategy is not None:
        require_adaptable(as_text(strategy, "strategy"), chosen)
    steps = as_count(steps, "steps")
    episodes_per_step = as_count(episodes_per_step, "episodes_per_step")
    max_episodes = None if max_episodes is None else as_count(max_episodes, "max_episodes")
    run = as_run(run)
    system = as_system(run.case, system)
    default, notices = default_strategy(run.case)
    warn_of((*run.warnings, *cut_off_warnings(system), *(notices if strategy is None else ())))
    if isinstance(shield, int | float | np.number):
        shield = ShieldSettings(as_number(shield, "shield"))
    problem = adaptation_problem(
        run,
        system,
        episodes_per_step=episodes_per_step,
        conditions=as_instance(conditions, Conditions, "conditions"),
        shield=None if shield is None else as_instance(shield, ShieldSettings, "shield"),
    )
    return adapt_to(
        problem, strategy or default, steps=steps, max_episodes=max_episodes, seeds=chosen, on_step=on_step
    )


def require_adaptable(strategy: str, seeds: Sequence[int]) -> None:
    """Refuse seeds and strategies that can't be used, before any work is done.

    Raises:
        InputError: there is no seed, or no such strategy.
    """
    if not seeds:
        raise InputError("there is no seed to adapt with")
    if parse_strategy(strategy) == (PRETRAINED, ALL):
        raise InputError(f"{strategy!r} is one policy for each task; adapt with one of them")


def adapt_to(
    problem: AdaptationProblem,
    strategy: str,
    *,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: Sequence[int] = (0,),
    on_step: OnStep = lambda: None,
) -> Adaptation:
    """Solve an adaptation problem, once for each seed; see `adapt`."""
    require_adaptable(strategy, seeds)
    found: list[tuple[Run, Floats, Floats, Safety, Reasons]] = []
    with one_thread():
        for seed in seeds:
            of_system, of_strategy = np.random.default_rng(seed).spawn(2)
            chosen = problem.strategy(strategy, of_strategy)
            limit = steps * chosen.episodes_per_update if max_episodes is None else max_episodes
            if max_episodes is not None and limit < chosen.episodes_per_update:
                raise InputError(
                    f"{strategy} takes {chosen.episodes_per_update} real episodes for a policy update; "
                    f"{limit} are too few"
                )
            found.append(_followed(seed, problem, chosen, of_system, limit, on_step))
    runs, before, after, safety, reasons = zip(*found, strict=True)
    truth = problem.truth
    return Adaptation(
        system=truth.system.name,
        conditions=problem.conditions,
        strategy=strategy,
        reachable=truth.reachable,
        runs=runs,
        before=before[0],
        after=after[0],
        reasons=reasons,
        model=truth.model_on(problem.context.index),
        safety=safety if problem.shield is not None or truth.declares_unsafe else (),
        within_shield=truth.safe_optimum,
    )


def _followed(
    seed: int,
    problem: AdaptationProblem,
    strategy: Strategy,
    generator: np.random.Generator,
    max_episodes: int,
    on_step: OnStep,
) -> tuple[Run, Floats, Floats, Safety, Reasons]:
    """Adapt once; return the run, the policies before and after, its safety, and the reasons row by row."""
    simulated = problem.simulated(generator)
    counted = problem.supervised(simulated)
    truth, index = problem.truth, problem.context.index
    model = truth.model_on(index)
    before = executed(model, strategy.policy())
    rows, reasons = [], []
    for row in adaptation_rows(counted, strategy, lambda policy: truth.value(policy, index), max_episodes):
        rows.append(row)
        reasons.append(strategy.explain())
        if row.step:
            on_step()
    run = judged(seed, rows, truth.reachable, simulated.steps_back)
    safety = counted.safety(strategy.report() if isinstance(strategy, ShieldedStrategy) else None)
    return run, before, executed(model, strategy.policy()), safety, tuple(reasons)


@dataclass(frozen=True, eq=False, repr=False)
class Spread(ShortRepr):
    """The spread of the policies that are learned for one combination each, and not adapted.

    Attributes:
        values: combination -> exact value of its policy on the true model, best first.
        best: the best of them played, as `pretrained:<combination>`.
        median: the same; the better of the two in the middle of an even number.
        worst: the same.
    """

    values: Mapping[str, float]
    best: Adaptation
    median: Adaptation
    worst: Adaptation

    @property
    def shown(self) -> tuple[Adaptation, ...]:
        """The best, median and worst policy, played."""
        return self.best, self.median, self.worst

    def as_dict(self) -> dict[str, Any]:
        """Return the results as JSON has them."""
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
    problem: AdaptationProblem,
    *,
    steps: int = 30,
    max_episodes: int | None = None,
    seeds: Sequence[int] = (0,),
    on_step: OnStep = lambda: None,
) -> Spread:
    """Play the best, median and worst of the policies that were learned for one combination each.

    They are chosen by the true model: this shows the range of a baseline and is no way to adapt. The
    arguments are those of `adapt`.
    """
    values = values_of_pretrained(problem)
    best, median, worst = (
        adapt_to(
            problem,
            f"{PRETRAINED}:{name}",
            steps=steps,
            max_episodes=max_episodes,
            seeds=seeds,
            on_step=on_step,
        )
        for name in best_median_worst(values)
    )
    return Spread(values, best, median, worst)


def values_of_pretrained(problem: AdaptationProblem) -> dict[str, float]:
    """Return combination of the base -> exact value here of the policy learned for it, best first."""
    names, index = problem.context.run.names, problem.context.index
    policies = problem.context.pretrained(names)
    values = {name: problem.truth.value(policy, index) for name, policy in zip(names, policies, strict=True)}
    return dict(sorted(values.items(), key=lambda item: -item[1]))


def best_median_worst(values: Mapping[str, float]) -> tuple[str, str, str]:
    """Return the names of the best, median and worst of values that are ranked best first."""
    ranked = list(values)
    return ranked[0], ranked[(len(ranked) - 1) // 2], ranked[-1]
