"""Checks across concerns: the distributions of external actions, and where episodes start."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from merap.concerns.combination import Capability, DeclaredCombination, Environment
from merap.concerns.document import KeyPath
from merap.concerns.external_action import ExternalAction
from merap.concerns.location_tables import step_scope
from merap.concerns.resolution_context import ResolutionContext, names_in
from merap.concerns.space import Attribute, Space
from merap.concerns.supports import Configurations, Support
from merap.errors import InputError
from merap.mdp.model import ROW_SUM_TOLERANCE, Ints
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import Column, Constant, Scope, evaluate, variables

# Configurations of a concern that are resolved and checked when the case is loaded; the
# remaining ones of a larger support are checked when they are asked for.
CHECKED_AT_LOAD = 1000


@dataclass(frozen=True, eq=False, repr=False)
class DistributionCheck(ShortRepr):
    """Refuses external actions whose outcomes are no distribution somewhere.

    Call it with an environment and a capability; pairs that agree on all that matters are
    checked once. Whether a move is blocked depends on the pair, so both cases are checked:
    primes read the target of the intended edge, or the own location.
    """

    context: ResolutionContext
    _checked: dict[Any, None] = field(default_factory=dict)

    def __call__(self, environment: Environment, capability: Capability) -> None:
        """Check one pair.

        Raises:
            InputError: names action, location, mode and configurations.
        """
        terminal = capability.innate.terminal if capability.innate else None
        drawn = tuple(
            (action.name, *((one.move, one.probability) for one in action.outcomes))
            for action in capability.external
        )
        key = (id(environment.attributes), drawn, terminal)
        if key in self._checked:
            return
        modes = np.flatnonzero(capability.terminal(max(1, len(self.context.modes))))
        processes = set(self.context.variables)
        for action in capability.external:
            if processes & names_in([outcome.probability for outcome in action.outcomes]):
                continue  # found out in the states that can be reached
            for steps in _steps(self.context, environment.attributes, action, modes):
                self._check_action(environment, capability, action, steps)
        self._checked[key] = None

    def _check_action(
        self, environment: Environment, capability: Capability, action: ExternalAction, steps: _Steps
    ) -> None:
        pair = f"(environment {environment.name}, capability {capability.name})"
        total = np.zeros(len(steps.here))
        for outcome in action.outcomes:
            with self.context.document.at("capability", "actions", action.name):
                found = evaluate(outcome.probability, steps.scope)
            prob = np.broadcast_to(found, total.shape).astype(np.float64)
            outside = np.flatnonzero(~((prob >= 0) & (prob <= 1 + ROW_SUM_TOLERANCE)))
            if len(outside):
                problem = f"an outcome has the probability {prob[outside[0]]:.10g}, not in [0, 1],"
                raise self._error(action, steps, int(outside[0]), problem, pair)
            total += prob
        off = np.flatnonzero(~(np.abs(total - 1) <= ROW_SUM_TOLERANCE))
        if len(off):
            problem = f"the probabilities sum to {total[off[0]]:.10g}, not 1,"
            raise self._error(action, steps, int(off[0]), problem, pair)

    def _error(self, action: ExternalAction, steps: _Steps, step: int, problem: str, pair: str) -> InputError:
        space, modes = self.context.space, self.context.modes
        where = f"at location {space.locations[steps.here[step]]} " if space.located else ""
        where += f"in mode {modes[steps.mode[step]]} " if modes else ""
        return self.context.document.error(
            ("capability", "actions", action.name), f"action {action.name}: {problem} {where}{pair}"
        )


@dataclass(frozen=True, eq=False)
class _Steps:
    """B steps: where they begin, in which mode, and what expressions read there."""

    here: Ints
    mode: Ints
    scope: Scope


def _steps(
    context: ResolutionContext, attributes: tuple[Attribute, ...], action: ExternalAction, modes: Ints
) -> Iterator[_Steps]:
    if all(isinstance(outcome.probability, Constant) for outcome in action.outcomes):
        yield _Steps(np.zeros(1, dtype=np.int64), modes[:1], {})
        return
    here = np.repeat(np.arange(context.space.num_locations), len(modes))
    mode = np.tile(modes, context.space.num_locations)
    yield _Steps(here, mode, _scope(context.space, attributes, here, here, mode))
    move = action.outcomes[0].move
    if move is not None and _reads_successor(action):
        exists = context.space.target[here, move] >= 0
        here, mode = here[exists], mode[exists]
        yield _Steps(
            here, mode, _scope(context.space, attributes, here, context.space.target[here, move], mode)
        )


def _reads_successor(action: ExternalAction) -> bool:
    read = [variable.name for outcome in action.outcomes for variable in variables(outcome.probability)]
    return any(name.endswith("'") for name in read)


def _scope(space: Space, attributes: tuple[Attribute, ...], here: Ints, there: Ints, mode: Ints) -> Scope:
    return {MODE_VARIABLE: Column.of(mode), **step_scope(space, attributes, here, there)}


def check_actions(
    context: ResolutionContext,
    actions: Iterable[str],
    support: Support[Capability],
    systems: Iterable[DeclaredCombination],
) -> None:
    """Refuse external actions that no capability has, if there are few enough to look at all.

    Args:
        context: what the case has in common.
        actions: names of the external actions.
        support: the capabilities.
        systems: that are met online.

    Raises:
        InputError: names the first such action.
    """
    if support.count > CHECKED_AT_LOAD:
        return
    capabilities = (*support, *(system.capability for system in systems))
    had = {action.name for capability in capabilities for action in capability.external}
    for name in actions:
        if name not in had:
            raise context.document.error(
                ("capability", "actions", name, "requires"),
                f"nobody has the action {name}: no configuration and no online system makes requires true",
            )


def check_starts(
    context: ResolutionContext, concern: str, configurations: Configurations, parameter: str, starts: set[int]
) -> None:
    """Refuse configurations in which a start location is closed.

    Args:
        context: what the case has in common.
        concern: `environment` or `capability`.
        configurations: of that concern.
        parameter: its parameter that closes locations.
        starts: indices of the locations where some objective starts.

    Raises:
        InputError: names the location and a configuration.
    """
    what = "is blocked" if concern == "environment" else "can't be entered"
    for start in sorted(starts):
        offending = configurations.first_with(parameter, start)
        if offending is not None:
            name = configurations.name(offending)
            raise context.document.error(
                (concern, "configurations", name, parameter),
                f"the start location {context.space.locations[start]} {what} ({concern} {name}); "
                "leave it out (generated configurations: with except)",
            )


def check_system_start(context: ResolutionContext, path: KeyPath, system: DeclaredCombination) -> None:
    """Refuse an online system whose start is closed.

    Raises:
        InputError: names the location.
    """
    for closed, what in (
        (system.environment.blocked, "is blocked"),
        (system.capability.no_entry, "can't be entered"),
    ):
        bad = np.flatnonzero((system.objective.start > 0) & closed)
        if len(bad):
            raise context.document.error(path, f"the start location {context.space.locations[bad[0]]} {what}")
