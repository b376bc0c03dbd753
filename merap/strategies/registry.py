"""Make every adaptation strategy by its name.

A name may have an argument after a colon: `pretrained:<combination>`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from merap.belief.refinement import Refinement
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.steps import beyond_places_and_modes
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import CaseStudy
from merap.concerns.lookup import declared_case
from merap.errors import InputError
from merap.families.build import ModelBase
from merap.families.models import built
from merap.learning.meta import MetaPolicy
from merap.learning.tasks import TaskBatch
from merap.mdp.index import FamilyIndex, carried
from merap.mdp.model import Floats, TabularMDP
from merap.program.names import suggestion
from merap.runs.checkpoint import read_policy
from merap.runs.policy_on_index import on_index
from merap.runs.run_folder import RunFolder, read_base
from merap.runs.train import batch_of
from merap.strategies.baselines import joint_policy, pretrained_policies
from merap.strategies.fixed import FixedStrategy, optimal_policy
from merap.strategies.gradient import GradientStrategy, untrained
from merap.strategies.retrieval import RetrievalStrategy
from merap.systems.strategy import Strategy

GRADIENT, BELIEF, OPE, PRETRAINED = "gradient", "belief", "ope", "pretrained"
JOINT, RETRIEVAL, ORACLE = "joint", "retrieval", "oracle"
STRATEGIES: tuple[str, ...] = (GRADIENT, BELIEF, OPE, PRETRAINED, JOINT, RETRIEVAL, ORACLE)
# These take `episodes_per_step` real episodes for a policy update, the others one.
STEPPING = (GRADIENT, OPE)
# The argument of `pretrained` that stands for every combination of the base.
ALL = "all"


@dataclass(frozen=True, eq=False)
class StrategyContext:
    """The means of strategies; an expensive one is made when first needed, and once.

    Attributes:
        run: a finished training run.
        horizon: T, steps of an episode of the system.
        discount: discount of a step.
        episodes_per_step: B, real episodes of a gradient step.
        true_model: true model of the system, whole; only `oracle` may look.
        met: whole models of the systems that may be met, whose states are on the index.
    """

    run: RunFolder
    horizon: int
    discount: float
    episodes_per_step: int = 35
    true_model: TabularMDP | None = field(default=None, repr=False)
    met: tuple[TabularMDP, ...] = field(default=(), repr=False)

    @cached_property
    def learned_base(self) -> ModelBase:
        """The run's base, on the index that its policy was learned on."""
        return read_base(self.run)

    @cached_property
    def learned(self) -> MetaPolicy:
        """The meta policy of the run, on the same index."""
        return read_policy(self.run, batch_of(self.learned_base))

    @cached_property
    def base(self) -> ModelBase:
        """The run's base, on an index with the states of the systems that may be met."""
        return self.learned_base.extended(*self.met)

    @property
    def index(self) -> FamilyIndex:
        """S states."""
        return self.base.index

    @cached_property
    def tasks(self) -> TaskBatch:
        """The models of the base as arrays."""
        return batch_of(self.base)

    @cached_property
    def meta(self) -> MetaPolicy:
        """The meta policy of the run, for these states."""
        return on_index(self.learned, self.learned_base.index, self.index, self.base.kinds)

    @cached_property
    def hypotheses(self) -> HypothesisSpace:
        """The hypotheses about the domain.

        Raises:
            InputError: no belief is kept over the family.
        """
        why = beyond_places_and_modes(self.run.case.combination_at(0))
        if why is not None:
            raise InputError(f"{self.run.case.name}: no belief is kept over this family so far, since {why}")
        return hypothesis_space(declared_case(self.run.case), index=self.index)

    def pretrained(self, names: Sequence[str]) -> list[Floats]:
        """Return float64 [S, A] for each combination: the policy learned for it.

        Raises:
            InputError: there is no such combination, or a stored policy does not fit.
        """
        known = self.learned_base
        inside = [name for name in names if name in known.names]
        found = self._searched(known, inside, lambda some: batch_of(read_base(self.run, some)))
        for name in names:
            if name not in found:
                combination = self.run.case.combination(name)
                whole = built(combination)
                alone = replace(
                    known, names=(name,), models=(), horizons=(combination.objective.horizon,)
                ).extended(whole)
                task = replace(alone, models=(alone.index.place(whole),))
                found |= self._searched(alone, [name], partial(_tasks_of, task))
        return [found[name] for name in names]

    def _searched(
        self, base: ModelBase, names: Sequence[str], tasks: Callable[[Sequence[str]], TaskBatch]
    ) -> dict[str, Floats]:
        """Return the policy for each name, searched for on an index of its own."""
        network = on_index(self.learned, self.learned_base.index, base.index, base.kinds).network
        policies = pretrained_policies(self.run, network, names, tasks)
        return {name: self._here(policy, base) for name, policy in zip(names, policies, strict=True)}

    def joint(self) -> Floats:
        """Return float64 [S, A], one policy learned for all tasks of the base.

        Raises:
            InputError: a stored policy does not fit.
        """
        base = self.learned_base
        return self._here(joint_policy(self.run, self.learned.network, lambda: batch_of(base)), base)

    def _here(self, policy: Floats, base: ModelBase) -> Floats:
        table: Floats = carried(policy, base.index, self.index, 1 / policy.shape[-1])
        return table

    def having_learned(self, meta: MetaPolicy, hypotheses: HypothesisSpace) -> StrategyContext:
        """Return a copy with another meta policy and another prior, which keeps all that was made already."""
        other = copy(self)
        other.__dict__.update(meta=meta, hypotheses=hypotheses)  # where cached properties are kept
        return other


def _gradient(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    return GradientStrategy(context.meta, context.index, context.episodes_per_step, generator)


def _ope(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    start = untrained(context.meta, generator)
    episodes = context.episodes_per_step
    return GradientStrategy(start, context.index, episodes, generator, trained=False)


def _belief(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    (of_models,) = generator.spawn(1)
    refine = Refinement(context.meta, context.hypotheses, context.horizon, of_models)
    return BeliefStrategy(context.hypotheses, context.horizon, generator, refine=refine)


def _pretrained(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    (policy,) = context.pretrained([argument])
    reason = f"the policy learned for {argument}, not adapted"
    return FixedStrategy(policy, context.index, generator, reason)


def _joint(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    reason = f"one policy learned for all {len(context.run.names)} tasks, not adapted"
    return FixedStrategy(context.joint(), context.index, generator, reason)


def _retrieval(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    return RetrievalStrategy(context.base, context.tasks, context.horizon, generator)


def _oracle(context: StrategyContext, argument: str, generator: np.random.Generator) -> Strategy:
    if context.true_model is None:
        raise InputError("the strategy 'oracle' needs the true model, which is not known here")
    policy = optimal_policy(context.index.place(context.true_model), context.horizon)
    return FixedStrategy(policy, context.index, generator, "best on the true model")


def _tasks_of(base: ModelBase, names: Sequence[str]) -> TaskBatch:
    assert tuple(names) == base.names, names
    return batch_of(base)


Maker = Callable[[StrategyContext, str, np.random.Generator], Strategy]
_MAKERS: Mapping[str, Maker] = {
    GRADIENT: _gradient,
    BELIEF: _belief,
    OPE: _ope,
    PRETRAINED: _pretrained,
    JOINT: _joint,
    RETRIEVAL: _retrieval,
    ORACLE: _oracle,
}


def make_strategy(name: str, context: StrategyContext, generator: np.random.Generator) -> Strategy:
    """Make a strategy before any episode.

    Args:
        name: one of `STRATEGIES`; `pretrained` with the name of a combination after a colon.
        context: its means.
        generator: draws everything random in it.

    Raises:
        InputError: there is no such strategy or combination, the run is not finished, or a stored
            baseline does not fit.
    """
    kind, argument = parse_strategy(name)
    return _MAKERS[kind](context, argument, generator)


def default_strategy(case: CaseStudy) -> tuple[str, tuple[str, ...]]:
    """Return the strategy of those who name none, and a sentence that says so where it is not `belief`."""
    why = beyond_places_and_modes(case.combination_at(0))
    if why is None:
        return BELIEF, ()
    return GRADIENT, (
        f"{case.name}: no belief is kept over this family so far, since {why}: adapting by {GRADIENT}",
    )


def parse_strategy(name: str) -> tuple[str, str]:
    """Split a name into the strategy and its argument, which may be empty.

    Raises:
        InputError: there is no such strategy, or it takes another argument.
    """
    kind, colon, argument = name.partition(":")
    if kind not in STRATEGIES:
        raise InputError(f"there is no strategy {kind!r}{suggestion(kind, STRATEGIES)}")
    if kind == PRETRAINED and not argument:
        raise InputError(f"{name!r} lacks a combination; expected pretrained:<combination> or pretrained:all")
    if kind != PRETRAINED and colon:
        raise InputError(f"the strategy {kind!r} takes no argument, got {name!r}")
    return kind, argument


def episodes_per_update(name: str, episodes_per_step: int) -> int:
    """Return the number of real episodes for a policy update of a strategy."""
    return episodes_per_step if parse_strategy(name)[0] in STEPPING else 1
