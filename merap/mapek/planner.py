"""The planner: chooses the next action, by the learner that explores or by the policy it has made.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from merap.mapek.learner import Learner
from merap.mapek.messages import Analysis, Monitored, Plan
from merap.mdp.model import Bools, Floats
from merap.systems.deadline import DeadlineRunner, Lateness

# (episode, step) of plans that were not made in time.
Late = Mapping[tuple[int, int], Lateness]


class Planner:
    """Plans one action at a time.

    While the policy is adapted and the state is seen, the learner chooses the action, since it explores.
    Otherwise the policy is carried out: in the state that is seen, or averaged over those where the system
    may be. The fallback action replaces a plan that is late.

    The learner works beside the loop. A policy that it is still making is carried out from the first
    plan on that finds it made, and any plan until then is late.

    Attributes:
        table: float64 [S, A] or [T, S, A], the policy that is carried out.

    Args:
        learner: makes the policy.
        fallback: number of the action that is always safe; None: the first that is allowed.
        runner: keeps the deadline, and runs the learner.
        generator: draws actions from the policy.
        late: plans that were late when they were recorded.
    """

    def __init__(
        self,
        learner: Learner,
        fallback: int | None,
        runner: DeadlineRunner,
        generator: np.random.Generator,
        late: Late,
    ) -> None:
        self._learner = learner
        self._fallback = fallback
        self._runner = runner
        self._generator = generator
        self._late = late
        self._expected: Callable[[], Floats] | None = None
        self.table: Floats = np.empty((0, 0))

    def adopt(self, table: Floats) -> None:
        """Carry out this policy, float64 [S, A] or [T, S, A], from now on."""
        self.table, self._expected = table, None

    def expect(self, made: Callable[[], Floats]) -> None:
        """Carry out a policy as soon as the learner has finished its earlier work."""
        self._expected = made

    def catch_up(self) -> None:
        """Adopt the expected policy, since the learner has finished its earlier work."""
        if self._expected is not None:
            self.adopt(self._expected())

    def plan(self, monitored: Monitored, analysis: Analysis, allowed: Bools) -> Plan:
        """Return the next action, one of those allowed (bool [A], not empty)."""
        if monitored.problems:
            return self._fall_back(allowed, monitored.problems[-1])
        action: int | Lateness | None = None
        # The learner has been told of a state that is seen: that came with the same message.
        if analysis.phase == "adapting" and monitored.state is not None:
            action = self._asked(monitored, partial(self._learner.act, allowed))
        elif self._expected is not None:
            action = self._asked(monitored, _nothing)
        if isinstance(action, Lateness):
            return self._fall_back(allowed, action.value)
        if action is not None:
            return Plan(action, "exploration")
        return self._by_policy(monitored, analysis, allowed)

    def _asked(self, monitored: Monitored, work: Callable[[], int | None]) -> int | Lateness | None:
        """Return the answer of the learner, after its earlier work; a lateness if it is not in time."""
        recorded = self._late.get((monitored.episode, monitored.step))
        if recorded is Lateness.BUSY:
            return recorded
        answer = self._runner.in_time(work)
        if answer is not Lateness.BUSY:
            self.catch_up()
        return answer if recorded is None else recorded

    def _fall_back(self, allowed: Bools, reason: str) -> Plan:
        """Return the fallback action, or the first allowed one where it is not allowed."""
        if self._fallback is not None and allowed[self._fallback]:
            return Plan(self._fallback, "fallback", reason)
        return Plan(int(np.flatnonzero(allowed)[0]), "fallback", reason)

    def _by_policy(self, monitored: Monitored, analysis: Analysis, allowed: Bools) -> Plan:
        table = self.table
        if table.ndim == 3:
            table = table[min(monitored.step, len(table) - 1)]
        shares = (analysis.whereabouts @ table) * allowed
        if shares.sum() <= 0:
            shares = allowed.astype(np.float64)
        action = int(self._generator.choice(len(shares), p=shares / shares.sum()))
        return Plan(action, "prediction" if monitored.state is None else "policy")


def _nothing() -> None:
    """Ask the learner for nothing but to finish its earlier work."""
