"""Meta-learning over models that are no case: anything tabular, for example imported from Gymnasium."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy
from merap.learning.metrics import UpdateMetrics
from merap.learning.observation import VariableKind
from merap.learning.tasks import task_batch
from merap.learning.training import train
from merap.mdp.model import TabularMDP


def train_models(
    models: Sequence[TabularMDP],
    horizon: int,
    discount: float,
    config: TrainingConfig | None = None,
    *,
    kinds: Sequence[VariableKind] | None = None,
    on_update: Callable[[UpdateMetrics], None] = lambda metrics: None,
) -> MetaPolicy:
    """Train a meta policy over a list of models, in memory.

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
    return train(tasks, config or TrainingConfig(), on_update)
