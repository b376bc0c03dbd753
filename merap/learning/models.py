"""Meta-learning in memory: over task batches, and over models that are no case."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from merap.families.observation import VariableKind
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy
from merap.learning.progress import UpdateMetrics
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.training import initial_state, meta_policy, policy_network, updates
from merap.mdp.model import TabularMDP


def train_tasks(
    tasks: TaskBatch,
    config: TrainingConfig,
    on_update: Callable[[UpdateMetrics], None] = lambda metrics: None,
) -> MetaPolicy:
    """Train a meta policy, in memory.

    Args:
        tasks: the base.
        config: every setting.
        on_update: called after each update.
    """
    state = initial_state(policy_network(tasks, config), config, tasks.dtype)
    for metrics in updates(tasks, config, state):
        on_update(metrics)
    return meta_policy(tasks, config, state)


def train_models(
    models: Sequence[TabularMDP],
    horizon: int,
    discount: float,
    config: TrainingConfig | None = None,
    *,
    kinds: Sequence[VariableKind] | None = None,
    on_update: Callable[[UpdateMetrics], None] = lambda metrics: None,
) -> MetaPolicy:
    """Train a meta policy over models that are no case, for example imported from Gymnasium.

    Args:
        models: N models in canonical form with equal states and actions, as
            `merap.mdp.gymnasium_import` and `merap.families.build` make them.
        horizon: T, steps of an episode, at least 1.
        discount: in [0, 1].
        config: every setting; None for the defaults.
        kinds: of the state variables, for the factored observation; None for what names and
            values tell.
        on_update: called after each update.

    Raises:
        ModelError: there is no model, or one has other states or actions than the first.
    """
    tasks = task_batch(models, horizon, discount, kinds=kinds)
    return train_tasks(tasks, config or TrainingConfig(), on_update)
