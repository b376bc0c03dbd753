"""An outer objective on three small tasks, and slopes of functions of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from merap.learning.config import Activation, Estimator, Span, TrainingConfig
from merap.learning.drawing import Drawn, Seen
from merap.learning.inner_loop import given
from merap.learning.meta import step_rule
from merap.learning.objective import OuterGradient, OuterObjective, outer_objective
from merap.learning.policy import Parameters, PolicyNetwork, flat, shaped
from merap.learning.tasks import TaskBatch
from tests.support.learning_examples import (
    random_parameters,
    ring_batch,
    seeded,
)

SEED = 17
VARIANCE = torch.tensor(3.0, dtype=torch.float64)
LOG_SIZES = -1 + 0.2 * torch.arange(4, dtype=torch.float64)
Order = Literal[1, 2]


def make_config(
    estimator: Estimator = "exact",
    inner_steps: int = 1,
    order: Order = 2,
    activation: Activation = "softplus",
    span: Span = "horizon",
) -> TrainingConfig:
    return TrainingConfig(
        estimator=estimator,
        inner_steps=inner_steps,
        order=order,
        episodes=12,
        hidden=(4,),
        activation=activation,
        span=span,
    )


@dataclass(frozen=True)
class Setting:
    """Three tasks, a policy, and how it is adapted."""

    config: TrainingConfig
    tasks: TaskBatch
    network: PolicyNetwork
    theta: Tensor

    @property
    def objective(self) -> OuterObjective:
        return outer_objective(self.tasks, self.network, self.config, torch.get_num_threads())

    def drawn(self) -> tuple[OuterGradient, list[Drawn], Seen]:
        rule = step_rule(self.config, self.tasks.discount).advantage_rule(VARIANCE)
        drawn, seen, gradient = self.objective.draw(self.theta, LOG_SIZES, rule, self.config, seeded(SEED))
        return gradient or self.objective.gradient(self.theta, LOG_SIZES, drawn), drawn, seen

    def worth(self, theta: Tensor, log_sizes: Tensor, drawn: list[Drawn]) -> float:
        return self.objective.judge(theta, log_sizes, drawn)[0]

    def adapted(self, drawn: list[Drawn]) -> Parameters:
        (loop,) = self.objective.loops
        return loop.adapt(self.parameters, LOG_SIZES.exp().unbind(), given(drawn[0].losses))

    @property
    def parameters(self) -> Parameters:
        return shaped(self.theta, self.network)


def make_setting(config: TrainingConfig) -> Setting:
    tasks = ring_batch()
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, config.hidden, config.activation)
    return Setting(config, tasks, network, flat(random_parameters(network, 0)))


def slopes_of(value: Callable[[Tensor], float], at: Tensor) -> Tensor:
    """Central differences in every entry."""
    step = 1e-5
    shifts = step * torch.eye(len(at), dtype=at.dtype)
    slopes = [(value(at + shift) - value(at - shift)) / (2 * step) for shift in shifts]
    return torch.tensor(slopes, dtype=at.dtype)


def relative_error(found: Tensor, expected: Tensor) -> float:
    return float((found - expected).norm() / expected.norm())
