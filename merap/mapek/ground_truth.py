"""What is really there at each stage: for the simulation and the report, never for the loop's parts.

Axes: S states of the canonical index, the completed state is the last; P locations, Q modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from merap.mapek.scenario import Stage
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.shield.safe_optimum import safe_value
from merap.shield.supervision import unsafe_of
from merap.strategies.evaluation import Range
from merap.strategies.protocol import executed
from merap.systems.slip import slipping_model


@dataclass(frozen=True, eq=False)
class Truth:
    """A stage as it is.

    Attributes:
        stage: what is declared.
        model: canonical, slip included.
        reachable: undiscounted returns of the best and the worst time-indexed policy.
        discounted_optimum: of the best time-indexed policy.
        unsafe: bool [P * Q], by location and mode.
        slip: probability that an action does nothing.
        threshold: of the shield; None: there is none.
        safe_optimum: undiscounted return of the best policy within the threshold, if the model is known;
            None: there is no shield.
    """

    stage: Stage
    model: TabularMDP
    reachable: Range
    discounted_optimum: float
    unsafe: Bools
    slip: float
    threshold: float | None
    safe_optimum: float | None

    def value(self, policy: Floats) -> float:
        """What a policy, float64 [S, A] or [T, S, A], is worth: its expected undiscounted return."""
        horizon = self.stage.system.objective.horizon
        return expected_return(self.model, executed(self.model, policy), horizon)

    def starting(self, place: int) -> Truth:
        """The same for an episode that begins in location p and mode q, where `place` is p * Q + q."""
        return _truth(self.stage, self.slip, self.threshold, place)


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


def _truth(stage: Stage, slip: float, threshold: float | None, place: int | None = None) -> Truth:
    system, objective = stage.system, stage.system.objective
    model = slipping_model(system, slip)
    if place is not None:
        model = replace(model, initial=np.eye(1, model.num_states, place)[0])
    unsafe = unsafe_of(system)
    nowhere = np.zeros(model.num_states - 1, dtype=np.bool_)
    return Truth(
        stage=stage,
        model=model,
        reachable=Range(optimum(model, objective.horizon), worst_value(model, objective.horizon)),
        discounted_optimum=optimum(model, objective.horizon, system.discount),
        unsafe=nowhere if unsafe is None else unsafe,
        slip=slip,
        threshold=threshold,
        safe_optimum=None if threshold is None else safe_value(system, slip, threshold, place),
    )
