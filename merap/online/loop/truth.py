"""What is really there at each stage: for the simulation and the report, never for the loop's parts.

Axes: S states of the canonical index, the completed state is the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.concerns.steps import holds_in_states
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.online.curve import Range
from merap.online.loop.scenario import Stage
from merap.online.managed.slip import slipping_model
from merap.online.running import executed
from merap.online.shield.constrained import constrained_optimum


@dataclass(frozen=True, eq=False)
class Truth:
    """A stage as it is.

    Attributes:
        stage: what is declared.
        model: canonical, slip included.
        reachable: undiscounted returns of the best and the worst time-indexed policy.
        discounted_optimum: of the best time-indexed policy.
        unsafe: bool [S].
        safe_optimum: undiscounted return of the best policy within the shield's threshold, if the
            model is known; None: there is no shield.
    """

    stage: Stage
    model: TabularMDP
    reachable: Range
    discounted_optimum: float
    unsafe: Bools
    safe_optimum: float | None

    def value(self, policy: Floats) -> float:
        """What a policy, float64 [S, A] or [T, S, A], is worth: its expected undiscounted return."""
        horizon = self.stage.system.objective.horizon
        return expected_return(self.model, executed(self.model, policy), horizon)


def truths(stages: Sequence[Stage], slip: float, threshold: float | None = None) -> tuple[Truth, ...]:
    """What is there at each stage.

    Args:
        stages: of the scenario.
        slip: probability that an action does nothing.
        threshold: of the shield; None: there is none.

    Raises:
        InputError: a reachable state has no action; names it.
    """
    return tuple(_truth(stage, slip, threshold) for stage in stages)


def _truth(stage: Stage, slip: float, threshold: float | None) -> Truth:
    system, objective = stage.system, stage.system.objective
    model = slipping_model(system, slip)
    unsafe = np.zeros(model.num_states, dtype=np.bool_)
    if objective.unsafe is not None:
        unsafe[:-1] = holds_in_states(system, objective.unsafe)
    safe = None
    if threshold is not None:
        safe = constrained_optimum(model, unsafe, threshold, objective.horizon)
    return Truth(
        stage=stage,
        model=model,
        reachable=Range(optimum(model, objective.horizon), worst_value(model, objective.horizon)),
        discounted_optimum=optimum(model, objective.horizon, system.discount),
        unsafe=unsafe,
        safe_optimum=safe,
    )
