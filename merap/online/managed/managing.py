"""Manage a system whose true model nobody knows: a strategy adapts, and what it earns is reported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from merap.errors import InputError
from merap.learning.run_folder import RunFolder
from merap.online.managed.faults import SystemFault
from merap.online.managed.guarded import GuardedSystem, Retries
from merap.online.managed.guarded_strategy import GuardedStrategy
from merap.online.managed.served_dialect import open_served
from merap.online.running import episode
from merap.online.strategies.registry import StrategyContext, make_strategy
from merap.online.strategy import Strategy
from merap.online.systems import ManagedSystem

OnEpisode = Callable[[int, float], None]


@dataclass(frozen=True)
class Patience:
    """How long a manager waits, and what it does then.

    Attributes:
        timeout: seconds for a request to the system.
        retries: of requests that fail.
        decision: seconds for a decision of the strategy; None: as long as it takes.
        fallback: name of a safe action, for when the system or the strategy is late.
    """

    timeout: float = 5.0
    retries: int = 3
    decision: float | None = None
    fallback: str | None = None

    def __post_init__(self) -> None:
        if self.decision is not None and self.fallback is None:
            raise InputError(
                "a deadline for decisions needs a fallback, the action that is taken when they are late"
            )


@dataclass(frozen=True)
class Management:
    """What a strategy earned from a system.

    Attributes:
        system: where it is.
        strategy: its name.
        returns: undiscounted, of each episode.
        faults: kind -> how many there were, those that a retry has mended among them.
        late: how many decisions were late.
        explanation: plain lines of the strategy, at the end.
        ended_by: the fault that ended it before its last episode; None: there was none.
    """

    system: str
    strategy: str
    returns: tuple[float, ...]
    faults: dict[str, int]
    late: int
    explanation: tuple[str, ...]
    ended_by: SystemFault | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "system": self.system,
            "strategy": self.strategy,
            "returns": list(self.returns),
            "faults": self.faults,
            "late_decisions": self.late,
            "explanation": list(self.explanation),
            "ended_by": None if self.ended_by is None else str(self.ended_by),
        }


def manage(
    run: RunFolder,
    url: str,
    *,
    strategy: str,
    episodes: int,
    episodes_per_step: int = 35,
    seed: int = 0,
    patience: Patience | None = None,
    on_episode: OnEpisode = lambda number, earned: None,
) -> Management:
    """Let a strategy adapt to a system of the run's case that `merap serve` offers.

    A fault that no retry and no fallback mends ends it; what was earned until then is the result.

    Args:
        run: a finished training run.
        url: where the system is.
        strategy: its name, see `strategies.registry`; `oracle` needs a true model and can't.
        episodes: real episodes.
        episodes_per_step: real episodes of a gradient step.
        seed: of the strategy.
        patience: with the system and the strategy.
        on_episode: called after each with its number, from 1 on, and its return.

    Raises:
        InputError: there is no such strategy or fallback, or the system is none of the case.
    """
    given = patience or Patience()
    case = run.case
    variables = (*case.space.variable_names, "mode")
    faults: Counter[str] = Counter()

    def count(fault: SystemFault) -> None:
        faults[fault.kind] += 1

    returns: list[float] = []
    late, ended_by = 0, None
    explanation: tuple[str, ...] = ()
    try:
        with open_served(url, timeout=given.timeout, actions=case.actions, variables=variables) as system:
            horizon = system.interface.horizon or case.combination_at(0).objective.horizon
            context = StrategyContext(run, horizon, case.discount, episodes_per_step)
            acting = make_strategy(strategy, context, np.random.default_rng(seed))
            guarded = GuardedSystem(
                system, retries=Retries(given.retries), fallback=given.fallback, on_fault=count
            )
            guard = _guarded(acting, case.actions, given)
            for earned in _episodes(guarded, guard, episodes):
                if isinstance(earned, SystemFault):
                    ended_by = earned
                    break
                returns.append(earned)
                on_episode(len(returns), earned)
            explanation = guard.explain()
            late = guard.times_late if isinstance(guard, GuardedStrategy) else 0
    except SystemFault as fault:
        ended_by = fault
    return Management(url, strategy, tuple(returns), dict(faults), late, explanation, ended_by)


def _guarded(strategy: Strategy, actions: tuple[str, ...], patience: Patience) -> Strategy:
    if patience.decision is None or patience.fallback is None:
        return strategy
    return GuardedStrategy(strategy, actions, deadline=patience.decision, fallback=patience.fallback)


def _episodes(system: ManagedSystem, strategy: Strategy, count: int) -> Iterator[float | SystemFault]:
    """The return of each episode; a fault is the last."""
    for number in range(1, count + 1):
        try:
            earned = episode(system, strategy)
        except SystemFault as fault:
            yield fault
            return
        yield earned
        if number % strategy.episodes_per_update == 0:
            strategy.update()
