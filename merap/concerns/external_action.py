"""The actions of a system on its environment (`EA` of the paper, section IV-A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from merap.concerns.processes import Change
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import TRUE, Expression

# The name of a process, and a change placed before its own.
Sets: TypeAlias = tuple[tuple[str, Change], ...]


@dataclass(frozen=True, repr=False)
class Outcome(ShortRepr):
    """One thing an external action can lead to.

    Attributes:
        move: index of the edge label it goes along; None stays.
        probability: over the mode and attributes; with a prime, of the location the action's
            first, intended outcome would lead to, so that complements add up to 1.
        sets: changes of processes that go with this outcome.
    """

    move: int | None
    probability: Expression
    sets: Sets = ()


@dataclass(frozen=True, repr=False)
class ExternalAction(ShortRepr):
    """An action on the environment.

    Attributes:
        name: of the action.
        outcomes: the first is the intended one.
        on_blocked: a blocked move stays, or disables the action if it is the intended one.
        requires: condition on the state: where it does not hold the action is disabled.
        sets: changes of processes that go with the action, drawn independently of its outcome.
    """

    name: str
    outcomes: tuple[Outcome, ...]
    on_blocked: Literal["stay", "disable"]
    requires: Expression = TRUE
    sets: Sets = ()

    @property
    def is_joint(self) -> bool:
        """Whether what processes become depends on the outcome."""
        return any(outcome.sets for outcome in self.outcomes)

    def mapped(self, change: Callable[[Expression], Expression]) -> ExternalAction:
        """Return the action with every expression changed."""

        def changed(sets: Sets) -> Sets:
            return tuple((name, one.mapped(change)) for name, one in sets)

        return replace(
            self,
            outcomes=tuple(
                Outcome(one.move, change(one.probability), changed(one.sets)) for one in self.outcomes
            ),
            requires=change(self.requires),
            sets=changed(self.sets),
        )
