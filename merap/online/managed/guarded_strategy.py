"""A guard against a planner that is late.

Axes: S states, A declared actions.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial

from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.online.managed.deadline import Punctual
from merap.online.strategy import Strategy
from merap.online.systems import Observation

log = logging.getLogger(__name__)


class GuardedStrategy:
    """A strategy that decides in time, or else a safe fallback action is taken; see `strategy.Strategy`.

    The strategy works in a thread of its own, where all its calls are made in their order. Only `act` is
    waited for, so updates happen while the system goes on. A strategy that is late observes later
    what was done in its place. Where the fallback is not allowed, the decision is waited for.

    Args:
        strategy: what decides.
        actions: A names.
        deadline: seconds for a decision.
        fallback: name of the action that is taken when it is late.

    Raises:
        InputError: the deadline is no positive number, or there is no such action.
    """

    def __init__(self, strategy: Strategy, actions: Sequence[str], *, deadline: float, fallback: str) -> None:
        if not deadline > 0:
            raise InputError(f"a deadline is a positive number of seconds, not {deadline}")
        if fallback not in actions:
            raise InputError(
                f"there is no action {fallback!r} to fall back on; allowed: {', '.join(actions)}"
            )
        self._strategy = strategy
        self._deadline = deadline
        self._name = fallback
        self._fallback = list(actions).index(fallback)
        self._punctual = Punctual[int](deadline, "guarded strategy")
        self.times_late = 0

    @property
    def episodes_per_update(self) -> int:
        """How many real episodes a policy update takes."""
        return self._strategy.episodes_per_update

    def begin(self, observation: Observation) -> None:
        """An episode begins."""
        self._punctual.later(partial(self._strategy.begin, observation))

    def act(self, allowed: Bools) -> int:
        """The strategy's action, or the fallback if it is late."""
        action = self._punctual.in_time(partial(self._strategy.act, allowed))
        if action is not None:
            return action
        self.times_late += 1
        if not allowed[self._fallback]:
            log.warning("no decision within %g s; %s is not allowed: waiting", self._deadline, self._name)
            return self._punctual.late_result()
        log.warning("no decision within %g s; falling back on %s", self._deadline, self._name)
        return self._fallback

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        self._punctual.later(partial(self._strategy.observe, action, observation))

    def update(self) -> None:
        """Change the policy by what has been seen, while the system goes on."""
        self._punctual.later(self._strategy.update)

    def policy(self) -> Floats:
        """What would act if learning stopped; waits for all that is under way."""
        return self._punctual.result(self._strategy.policy)

    def explain(self) -> tuple[str, ...]:
        """Plain lines; waits for all that is under way."""
        return self._punctual.result(self._strategy.explain)
