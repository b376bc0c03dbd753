"""Managers of a system: the whole loop, and simpler ones to compare it with.

The four simpler ones are those that the community of self-adaptive systems compares against.

Axes: S states, A declared actions.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass

import numpy as np

from merap.errors import InputError
from merap.families.build import ModelBase
from merap.mapek.learner import StrategyMaker
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_schema import StrategySpec
from merap.mdp.model import Bools, Floats
from merap.mdp.planning import optimum, worst_value
from merap.program.names import suggestion
from merap.strategies.fixed import FixedStrategy, optimal_policy
from merap.strategies.registry import (
    GRADIENT,
    ORACLE,
    PRETRAINED,
    StrategyContext,
    episodes_per_update,
    make_strategy,
    parse_strategy,
)
from merap.systems.interface import Observation
from merap.systems.strategy import Strategy

MERAP = "merap"
# A reactive manager is content with a return above this part of the way from the worst to the best.
CONTENT = 0.5


@dataclass(frozen=True)
class Manager:
    """The strategy of a loop, and how it adapts.

    Attributes:
        make: makes a strategy before any episode.
        updates: policy updates of an adaptation; None: it never ends.
        replans: whether the trigger is heeded.
    """

    make: StrategyMaker
    updates: int | None
    replans: bool


class RandomStrategy:
    """Takes any action that is allowed; see `systems.strategy.Strategy`.

    Args:
        shape: S and A.
        generator: draws its actions.
    """

    episodes_per_update = 1

    def __init__(self, shape: tuple[int, int], generator: np.random.Generator) -> None:
        self._shape = shape
        self._generator = generator

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode, or go on with it."""

    def act(self, allowed: Bools) -> int:
        """Return any of the allowed actions."""
        return int(self._generator.choice(np.flatnonzero(allowed)))

    def observe(self, action: int, observation: Observation) -> None:
        """Learn nothing."""

    def update(self) -> None:
        """Change nothing."""

    def policy(self) -> Floats:
        """Return float64 [S, A], uniform."""
        return np.full(self._shape, 1 / self._shape[1])

    def explain(self) -> tuple[str, ...]:
        """Return the reason for this policy."""
        return ("any action",)


class ReactiveStrategy:
    """Goes on to the next model's best policy when an episode went badly; see `systems.strategy.Strategy`.

    An episode went badly if it returned less than half of the way from the worst to the best return of
    the model that is tried.

    Args:
        base: the models, in the order in which they are tried.
        horizon: T.
        generator: draws its actions.
    """

    episodes_per_update = 1

    def __init__(self, base: ModelBase, horizon: int, generator: np.random.Generator) -> None:
        self._base = base
        self._horizon = horizon
        self._generator = generator
        self._taken = 0
        self._total = 0.0
        self._take(0)

    def _take(self, number: int) -> None:
        self._taken = number % len(self._base.models)
        model = self._base.models[self._taken]
        best, worst = optimum(model, self._horizon), worst_value(model, self._horizon)
        self._content = worst + CONTENT * (best - worst)
        policy = optimal_policy(model, self._horizon)
        self._fixed = FixedStrategy(policy, self._base.index, self._generator, self._base.names[self._taken])

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode, or go on with it."""
        if not resumed:
            self._total = 0.0
        self._fixed.begin(observation, time)

    def act(self, allowed: Bools) -> int:
        """Return an action of the policy that is tried."""
        return self._fixed.act(allowed)

    def observe(self, action: int, observation: Observation) -> None:
        """Add the reward of a step."""
        self._total += observation.reward
        self._fixed.observe(action, observation)

    def update(self) -> None:
        """Try the next policy if the episode went badly."""
        if self._total < self._content:
            self._take(self._taken + 1)

    def policy(self) -> Floats:
        """Return the policy that is tried."""
        return self._fixed.policy()

    def explain(self) -> tuple[str, ...]:
        """Return the name of the model that is tried."""
        return (
            f"the best policy for {self._base.names[self._taken]}; "
            f"another is tried after a return below {self._content:.3g}",
        )


def _merap(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(spec.name, context, generator), spec.updates, True)


def _none(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(GRADIENT, context, generator), 0, False)


def _static(spec: StrategySpec, context: StrategyContext) -> Manager:
    return Manager(lambda generator: make_strategy(spec.name, context, generator), spec.updates, False)


def _random(spec: StrategySpec, context: StrategyContext) -> Manager:
    shape = (context.index.num_states, len(context.run.case.actions))

    def make(generator: np.random.Generator) -> Strategy:
        return RandomStrategy(shape, generator)

    return Manager(make, None, False)


def _reactive(spec: StrategySpec, context: StrategyContext) -> Manager:
    def make(generator: np.random.Generator) -> Strategy:
        return ReactiveStrategy(context.base, context.horizon, generator)

    return Manager(make, None, False)


# `none` carries out the meta policy as it was trained; `static` adapts to the first system, and never again.
_MANAGERS: Mapping[str, Callable[[StrategySpec, StrategyContext], Manager]] = {
    MERAP: _merap,
    "none": _none,
    "random": _random,
    "static": _static,
    "reactive": _reactive,
}
MANAGERS: tuple[str, ...] = tuple(_MANAGERS)


def make_manager(name: str, spec: StrategySpec, context: StrategyContext) -> Manager:
    """Return a manager by its name.

    Args:
        name: one of `MANAGERS`.
        spec: spec of the scenario, for those that adapt.
        context: context of their strategies.

    Raises:
        InputError: there is no such manager.
    """
    if name not in _MANAGERS:
        raise InputError(f"there is no manager {name!r}{suggestion(name, _MANAGERS)}")
    return _MANAGERS[name](spec, context)


def require_strategy(scenario: Scenario, combinations: Container[str]) -> None:
    """Refuse a strategy that a loop can't have, before anything is learned or simulated.

    Args:
        scenario: names the strategy.
        combinations: combinations of the run's base.

    Raises:
        InputError: there is no such strategy, it is none for a loop, or there are too few episodes for one
            policy update; names the place in the scenario.
    """
    spec = scenario.spec.strategy
    with scenario.document.at("strategy", "name"):
        kind, argument = parse_strategy(spec.name)
        if kind == ORACLE:
            raise InputError(
                "'oracle' needs the true model, which no loop is told, not even of a simulated system; "
                "the report has its value as the optimum"
            )
        if kind == PRETRAINED and argument not in combinations:
            raise InputError(f"the base has no combination {argument!r} to play the policy of")
        needed = episodes_per_update(spec.name, spec.episodes_per_step)
    if needed > scenario.spec.episodes:
        raise scenario.document.error(
            ("strategy", "episodes_per_step"),
            f"a policy update of {kind!r} takes {needed} episodes, but the scenario has "
            f"{scenario.spec.episodes}; give fewer episodes_per_step, or more episodes",
        )
