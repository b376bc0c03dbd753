"""Who manages the system: the loop as it is meant, and simpler managers to compare it with.

The four others are those that the community of self-adaptive systems compares against.

Axes: S states, A declared actions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merap.concerns.names import suggestion
from merap.errors import InputError
from merap.mapek.learner import StrategyMaker
from merap.mapek.scenario_schema import StrategySpec
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.strategies.fixed import FixedStrategy, optimal_policy
from merap.strategies.registry import GRADIENT, StrategyContext, make_strategy
from merap.systems.interface import Observation
from merap.systems.strategy import Strategy

MERAP = "merap"
# A reactive manager is content with a return above this part of the way from the worst to the best.
CONTENT = 0.5


@dataclass(frozen=True)
class Manager:
    """What a loop is made with.

    Attributes:
        make: a strategy as it is before any episode.
        updates: policy updates of an adaptation; None: it never ends.
        replans: whether the trigger is heeded.
    """

    make: StrategyMaker
    updates: int | None
    replans: bool


class RandomStrategy:
    """Takes any action that is allowed; see `strategy.Strategy`.

    Args:
        shape: S and A.
        generator: of its actions.
    """

    episodes_per_update = 1

    def __init__(self, shape: tuple[int, int], generator: np.random.Generator) -> None:
        self._shape = shape
        self._generator = generator

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """An episode begins or goes on."""

    def act(self, allowed: Bools) -> int:
        """Any of the allowed actions."""
        return int(self._generator.choice(np.flatnonzero(allowed)))

    def observe(self, action: int, observation: Observation) -> None:
        """Nothing is learned."""

    def update(self) -> None:
        """Nothing changes."""

    def policy(self) -> Floats:
        """float64 [S, A], uniform."""
        return np.full(self._shape, 1 / self._shape[1])

    def explain(self) -> tuple[str, ...]:
        """Why this policy."""
        return ("any action",)


class ReactiveStrategy:
    """Goes on to the next model's best policy when an episode went badly; see `strategy.Strategy`.

    Badly means: it returned less than half of the way from the worst to the best that the model
    it takes to be in force lets expect.

    Args:
        names: of the models.
        models: of the base, in the order in which they are tried.
        horizon: T.
        generator: of its actions.
    """

    episodes_per_update = 1

    def __init__(
        self, names: Sequence[str], models: Sequence[TabularMDP], horizon: int, generator: np.random.Generator
    ) -> None:
        self._names, self._models = names, models
        self._horizon = horizon
        self._generator = generator
        self._taken = 0
        self._total = 0.0
        self._take(0)

    def _take(self, number: int) -> None:
        self._taken = number % len(self._models)
        model = self._models[self._taken]
        best, worst = optimum(model, self._horizon), worst_value(model, self._horizon)
        self._content = worst + CONTENT * (best - worst)
        policy = optimal_policy(model, self._horizon)
        self._fixed = FixedStrategy(policy, model.valuations, self._generator, self._names[self._taken])

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """An episode begins or goes on."""
        if not resumed:
            self._total = 0.0
        self._fixed.begin(observation, time)

    def act(self, allowed: Bools) -> int:
        """The action of the policy that is tried."""
        return self._fixed.act(allowed)

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        self._total += observation.reward
        self._fixed.observe(action, observation)

    def update(self) -> None:
        """React to the episode."""
        if self._total < self._content:
            self._take(self._taken + 1)

    def policy(self) -> Floats:
        """The policy that is tried."""
        return self._fixed.policy()

    def explain(self) -> tuple[str, ...]:
        """Which one it is."""
        return (
            f"the best policy for {self._names[self._taken]}; "
            f"another is tried after a return below {self._content:.3g}",
        )


def _merap(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(spec.name, context, generator), spec.updates, True)


def _none(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(GRADIENT, context, generator), 0, False)


def _static(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(spec.name, context, generator), spec.updates, False)


def _random(spec: StrategySpec, context: StrategyContext) -> Manager:
    shape = (len(context.valuations), len(context.run.case.actions))

    def make(generator: np.random.Generator) -> Strategy:
        return RandomStrategy(shape, generator)

    return Manager(make, None, False)


def _reactive(spec: StrategySpec, context: StrategyContext) -> Manager:
    def make(generator: np.random.Generator) -> Strategy:
        return ReactiveStrategy(context.run.names, context.models, context.horizon, generator)

    return Manager(make, None, False)


# `none` carries out the meta policy as it was trained; `static` adapts to what it meets first, and
# never again.
_MANAGERS: Mapping[str, Callable[[StrategySpec, StrategyContext], Manager]] = {
    MERAP: _merap,
    "none": _none,
    "random": _random,
    "static": _static,
    "reactive": _reactive,
}
MANAGERS: tuple[str, ...] = tuple(_MANAGERS)


def make_manager(name: str, spec: StrategySpec, context: StrategyContext) -> Manager:
    """A manager by its name.

    Args:
        name: one of `MANAGERS`.
        spec: of the scenario, for those that adapt.
        context: of their strategies.

    Raises:
        InputError: there is no such manager.
    """
    if name not in _MANAGERS:
        raise InputError(f"there is no manager {name!r}{suggestion(name, _MANAGERS)}")
    return _MANAGERS[name](spec, context)
