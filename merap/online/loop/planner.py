"""The planner: the next action, from the learner's exploration or the policy it has made.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Bools, Floats
from merap.online.loop.learner import Learner
from merap.online.loop.messages import Analysis, Monitored, Plan
from merap.online.managed.deadline import Punctual


class Planner:
    """Plans one action at a time.

    While the policy is adapted and the state is seen, the learner acts, for it explores. Otherwise
    the policy is carried out: in the state that is seen, or averaged over those where the system
    may be. A plan that is late is replaced by the fallback action.

    Args:
        learner: whose policy it is.
        fallback: number of the action that is always safe; None: the first that is allowed.
        punctual: keeps the deadline.
        generator: of actions drawn from the policy.
        late: (episode, step) of plans that were late when they were recorded.
    """

    def __init__(
        self,
        learner: Learner,
        fallback: int | None,
        punctual: Punctual[int],
        generator: np.random.Generator,
        late: frozenset[tuple[int, int]] = frozenset(),
    ) -> None:
        self._learner = learner
        self._fallback = fallback
        self._punctual = punctual
        self._generator = generator
        self._late = late
        self._table: Floats | None = None

    def adopt(self, table: Floats) -> None:
        """Carry out this policy, float64 [S, A] or [T, S, A], from now on."""
        self._table = table

    def plan(self, monitored: Monitored, analysis: Analysis, allowed: Bools) -> Plan:
        """The next action, one of those allowed (bool [A], not empty)."""
        exploring = analysis.phase == "adapting" and monitored.state is not None and self._learner.ready
        if not exploring:
            return self._by_policy(monitored, analysis, allowed)
        action = self._punctual.in_time(lambda: self._learner.act(allowed))
        if action is None or (monitored.episode, monitored.step) in self._late:
            return self.fall_back(allowed)
        return Plan(action, "exploration")

    def fall_back(self, allowed: Bools) -> Plan:
        """The fallback action, or the first that is allowed where it isn't."""
        if self._fallback is not None and allowed[self._fallback]:
            return Plan(self._fallback, "fallback")
        return Plan(int(np.flatnonzero(allowed)[0]), "fallback")

    def _by_policy(self, monitored: Monitored, analysis: Analysis, allowed: Bools) -> Plan:
        assert self._table is not None
        table = self._table
        if table.ndim == 3:
            table = table[min(monitored.step, len(table) - 1)]
        shares = (analysis.whereabouts @ table) * allowed
        if shares.sum() <= 0:
            shares = allowed.astype(np.float64)
        action = int(self._generator.choice(len(shares), p=shares / shares.sum()))
        return Plan(action, "prediction" if monitored.state is None else "policy")
