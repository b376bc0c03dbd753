"""Extension of the base: add a model that the base lacks, and train the meta policy further.

When an adaptation ends with most of the belief outside the base, the analyzer's model of the real
domain becomes one more task. The meta policy is trained further on tasks of the base and the added ones,
and the belief of the next adaptation begins with an updated prior (`belief.prior_update`), so that the same
configuration is recognised sooner. The same configuration is never added twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from merap.belief.posterior import Belief
from merap.belief.prior_update import base_weight, likeliest, updated_prior
from merap.belief.space import HypothesisSpace
from merap.learning.meta import MetaPolicy
from merap.learning.tasks import task_batch
from merap.learning.training import meta_policy, updates
from merap.mapek.learner import StrategyMaker
from merap.mdp.model import TabularMDP
from merap.runs.warm_start import begun_from
from merap.strategies.registry import StrategyContext

# Belief mass outside the base that triggers an extension.
MOST = 0.5


@dataclass(frozen=True, eq=False)
class BaseExtension:
    """One more model of the base, and the meta policy and the prior that come with it.

    Attributes:
        name: name of the model.
        model: on the index.
        meta: the new meta policy.
        updates: outer updates that have led to it, those of the training run included.
        hypotheses: with the updated prior.
        make: makes strategies that begin with both.
        reasons: why, in plain lines.
    """

    name: str
    model: TabularMDP = field(repr=False)
    meta: MetaPolicy = field(repr=False)
    updates: int
    hypotheses: HypothesisSpace = field(repr=False)
    make: StrategyMaker = field(repr=False)
    reasons: tuple[str, ...]


class BaseExtender:
    """Extends the base of a run, in memory; the run folder stays as it is.

    Args:
        context: context of the strategies so far.
        making: returns a maker of strategies for such a context.
        updates: outer updates after each addition.
    """

    def __init__(
        self,
        context: StrategyContext,
        making: Callable[[StrategyContext], StrategyMaker],
        updates: int,
    ) -> None:
        self._context = context
        self._making = making
        self._updates = updates
        self._added: list[TabularMDP] = []
        self._known: set[tuple[str, ...]] = set()

    def extend(self, episode: int, belief: Belief, model: TabularMDP) -> BaseExtension | None:
        """Add the model that an adaptation ended with, if the base lacks it.

        Args:
            episode: its last one.
            belief: the analyzer's.
            model: model of the real domain, on the index.
        """
        space = self._context.hypotheses
        outside, found = 1 - base_weight(space, belief), likeliest(space, belief)
        if outside <= MOST or found in self._known:
            return None
        self._known.add(found)
        self._added.append(model)
        meta, hypotheses = self._trained(), updated_prior(space, belief)
        self._context = self._context.having_learned(meta, hypotheses)
        name, number = f"met_{episode}", len(self._added)
        return BaseExtension(
            name=name,
            model=model,
            meta=meta,
            updates=self._context.run.config.updates + number * self._updates,
            hypotheses=hypotheses,
            make=self._making(self._context),
            reasons=(
                f"{outside:.2f} of the belief is outside the base ({', '.join(found)}): its model is "
                f"added as {name}, number {number} beside the {len(self._context.run.names)} of the base",
                f"the meta policy was trained on by {self._updates} updates",
            ),
        )

    def _trained(self) -> MetaPolicy:
        """Train the meta policy further; the seed is that of the run and the number of added models."""
        run = self._context.run
        config = run.config.model_copy(update={"updates": self._updates, "patience": 0})
        generator = np.random.default_rng([run.config.seed, len(self._added)])
        base = self._context.base
        models, horizons = self._chosen(config.tasks_per_update, generator)
        tasks = task_batch(models, horizons, base.discount, kinds=base.kinds)
        state = begun_from(self._context.meta, tasks, config)
        state.generator.manual_seed(int(generator.integers(2**63)))
        for _ in updates(tasks, config, state):
            pass
        return meta_policy(tasks, config, state)

    def _chosen(self, size: int, generator: np.random.Generator) -> tuple[list[TabularMDP], list[int]]:
        """Return the models added last, at most half of the tasks of an update, and others of the base.

        Their horizons are with them; an added model has that of the system.
        """
        added, base = self._added[-max(1, size // 2) :], self._context.base
        count = min(len(base.models), size - len(added))
        drawn = generator.choice(len(base.models), count, replace=False).tolist()
        return (
            [*added, *(base.models[number] for number in drawn)],
            [*[self._context.horizon] * len(added), *(base.horizons[number] for number in drawn)],
        )
