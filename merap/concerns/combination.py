"""One configuration of each concern: what is rendered, built, learned from and met.

All of them share what `Combination` has. The parts of a `DeclaredCombination`, of a case file, are resolved
and validated where they are made.

Axes: P locations, L edge labels, Q modes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal, TypeAlias

import numpy as np

from merap.concerns.composition import compose
from merap.concerns.document import KeyPath
from merap.concerns.external_action import ExternalAction
from merap.concerns.innate import Innate
from merap.concerns.processes import DeclaredProcess
from merap.concerns.space import Attribute, Space, passable
from merap.mdp.model import Bools, Floats
from merap.mdp.reserved_names import END_ACTION
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import FALSE, TRUE, ZERO, Constants, Expression
from merap.program.form import Program

# Changes an expression, given where the case file has it.
Change: TypeAlias = Callable[[KeyPath, Expression], Expression]
# How an episode after the first begins: at a start, after the way back there, or where the last one ended.
ResetMode = Literal["episodes", "return_to_start", "none"]


@dataclass(frozen=True, eq=False, repr=False)
class Configuration(ShortRepr):
    """A configuration of a concern.

    Attributes:
        name: of the configuration.
        parameters: their values, as given.
        known: what expressions of the case language read of them, by resolved names.
    """

    name: str
    parameters: Mapping[str, Any]
    known: Constants = field(default_factory=dict, kw_only=True)


@dataclass(frozen=True, eq=False, repr=False)
class Objective(Configuration):
    """A configuration of the user's objective.

    Attributes:
        horizon: steps of an episode.
        properties: name -> PRISM property.
    """

    horizon: int
    properties: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    def same_episodes(self, other: Objective) -> bool:
        """Return whether episodes begin alike and last as long."""
        return self.horizon == other.horizon


@dataclass(frozen=True, eq=False, repr=False)
class Environment(Configuration):
    """A configuration of the spatial environment.

    Attributes:
        blocked: bool [P], locations that are obstructed.
        blocked_edges: bool [P, L], edges that are obstructed.
        attributes: of the locations, as this configuration sets them.
        processes: of the environment, in declared order, doors first.
        locked: names of doors that nobody can pass or change; their edges are blocked.
    """

    blocked: Bools
    blocked_edges: Bools
    attributes: tuple[Attribute, ...]
    processes: tuple[DeclaredProcess, ...] = ()
    locked: frozenset[str] = frozenset()

    def mapped(self, change: Change) -> Environment:
        """Return the environment with every expression changed."""
        return replace(self, processes=_mapped(self.processes, change))


def _mapped(processes: Iterable[DeclaredProcess], change: Change) -> tuple[DeclaredProcess, ...]:
    return tuple(one.mapped(partial(change, one.path)) for one in processes)


@dataclass(frozen=True, eq=False, repr=False)
class Capability(Configuration):
    """A configuration of the system's capability.

    Attributes:
        no_entry: bool [P], locations this system can't enter.
        external: the external actions it has.
        innate: its automaton; None: one mode, terminal.
        processes: of the capability, in declared order.
    """

    no_entry: Bools
    external: tuple[ExternalAction, ...]
    innate: Innate | None
    processes: tuple[DeclaredProcess, ...] = ()

    @property
    def initial_mode(self) -> int:
        """The mode an episode begins in."""
        return self.innate.initial if self.innate else 0

    def terminal(self, num_modes: int) -> Bools:
        """bool [Q], the modes in which external actions are possible."""
        mask = np.ones(num_modes, dtype=np.bool_)
        if self.innate:
            mask[[mode for mode in range(num_modes) if mode not in self.innate.terminal]] = False
        return mask

    def mapped(self, change: Change) -> Capability:
        """Return the capability with every expression changed; it lacks what can never be enabled then."""
        external = (one.mapped(partial(change, ("capability", "actions", one.name))) for one in self.external)
        innate = self.innate and self.innate.mapped(change)
        return replace(
            self,
            external=tuple(_possible(external)),
            innate=None if innate is None or innate.requires == FALSE else innate,
            processes=_mapped(self.processes, change),
        )


def _possible(actions: Iterable[ExternalAction]) -> Iterator[ExternalAction]:
    """Leave out actions that are never enabled, and outcomes of probability 0.

    The first outcome says what is intended, so it stays even if it is impossible.
    """
    for action in actions:
        if action.requires != FALSE:
            likely = (one for one in action.outcomes[1:] if one.probability != ZERO)
            yield replace(action, outcomes=(action.outcomes[0], *likely))


@dataclass(frozen=True, eq=False, repr=False)
class Condition(ShortRepr):
    """A predicate over a step (s, a, s').

    Attributes:
        actions: names; None: any.
        where: condition on the state and, primed, the successor.
    """

    actions: frozenset[str] | None = None
    where: Expression = TRUE


@dataclass(frozen=True, eq=False, repr=False)
class RewardRule(ShortRepr):
    """`value`, over state and, primed, successor, is earned where `condition` is the first to hold."""

    condition: Condition
    value: Expression


@dataclass(frozen=True, eq=False, repr=False)
class DeclaredObjective(Objective):
    """A configuration of the user's objective that a case file declares (Definition 3 of the paper).

    Attributes:
        start: float64 [P], distribution over start locations.
        goal: states labelled `goal`; None: there is no goal.
        rules: first match wins, no match earns 0.
        ends_after: a step that completes the task (source and action); None: no such step.
        ends_in: states that are complete; None: none.
        unsafe: states to avoid; None: none.
        processes: of the objective, in declared order: they watch, and draw nothing.
        labels: name -> states, beside `goal` and `unsafe`.
    """

    start: Floats
    goal: Expression | None
    rules: tuple[RewardRule, ...]
    ends_after: Condition | None
    ends_in: Expression | None
    unsafe: Expression | None
    processes: tuple[DeclaredProcess, ...] = ()
    labels: Mapping[str, Expression] = field(default_factory=dict)

    def mapped(self, change: Change) -> DeclaredObjective:
        """Return the objective with every expression changed."""

        def states(key: str, where: Expression | None) -> Expression | None:
            return None if where is None else change(("objective", key), where)

        def steps(path: KeyPath, condition: Condition) -> Condition:
            return replace(condition, where=change(path, condition.where))

        return replace(
            self,
            goal=states("goal", self.goal),
            rules=tuple(
                RewardRule(
                    steps(("objective", "rewards", place), rule.condition),
                    change(("objective", "rewards", place, "value"), rule.value),
                )
                for place, rule in enumerate(self.rules)
            ),
            ends_after=self.ends_after and steps(("objective", "ends_after"), self.ends_after),
            ends_in=states("ends_in", self.ends_in),
            unsafe=states("unsafe", self.unsafe),
            processes=_mapped(self.processes, change),
            labels={name: change(("objective", "labels", name), one) for name, one in self.labels.items()},
        )

    def same_episodes(self, other: Objective) -> bool:
        """Return whether episodes begin alike and last as long."""
        same_start = isinstance(other, DeclaredObjective) and np.array_equal(self.start, other.start)
        return same_start and super().same_episodes(other)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Combination(ShortRepr, ABC):
    """One configuration of each concern, of whatever kind of case.

    Attributes:
        name: `<environment>.<capability>.<objective>`, or the name of an online system.
        actions: declared names, the same for the whole case.
        environment: its environment.
        capability: its capability.
        objective: its objective.
        discount: of a step, in (0, 1].
        digest: hexadecimal SHA-256 of the sources.
        reset: how an episode after the first begins, when the combination is met online.
    """

    name: str
    actions: tuple[str, ...]
    environment: Configuration
    capability: Configuration
    objective: Objective
    discount: float
    digest: str
    reset: ResetMode = "episodes"

    @property
    def action_names(self) -> tuple[str, ...]:
        """The declared actions and, last, `end`, which closes a complete state."""
        return (*self.actions, END_ACTION)

    @property
    @abstractmethod
    def program(self) -> Program:
        """The closed program, with the labels `complete`, `goal` and, where declared, `unsafe`.

        Its reward structures are `objective` and `steps`; in complete states `end` is the only action.

        Raises:
            InputError: the parts do not compose to a program.
        """


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DeclaredCombination(Combination):
    """A combination of a case file, over the case's space, modes and actions.

    Attributes:
        space: the locations.
        modes: Q names, the same for the whole case.
    """

    space: Space
    modes: tuple[str, ...]
    environment: Environment
    capability: Capability
    objective: DeclaredObjective

    @property
    def processes(self) -> tuple[DeclaredProcess, ...]:
        """What changes beside location, mode and completion, in order of declaration."""
        return (*self.environment.processes, *self.capability.processes, *self.objective.processes)

    @property
    def passable(self) -> Bools:
        """bool [P, L], the moves that are not blocked."""
        closed = self.environment.blocked | self.capability.no_entry
        return passable(self.space, closed, self.environment.blocked_edges)

    @cached_property
    def program(self) -> Program:
        """See `Combination`."""
        return compose(self)
