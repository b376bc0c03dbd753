"""The innate automaton of a system (Definition 2 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import TRUE, Expression


@dataclass(frozen=True, repr=False)
class InnateAction(ShortRepr):
    """A row of delta: mode -> {successor mode: probability}; undefined elsewhere."""

    name: str
    transitions: Mapping[int, Mapping[int, Fraction]]


@dataclass(frozen=True, repr=False)
class Innate(ShortRepr):
    """The innate automaton (Definition 2 of the paper); modes are indices.

    Attributes:
        name: of the automaton.
        entry: the paper's q0, where `start_<name>` leads.
        initial: the mode an episode begins in.
        terminal: F, the modes in which external actions are possible.
        restart: whether `start_<name>` exists.
        actions: in declared order.
        requires: condition on the state: where it does not hold none of its actions is enabled.
    """

    name: str
    entry: int
    initial: int
    terminal: frozenset[int]
    restart: bool
    actions: tuple[InnateAction, ...]
    requires: Expression = TRUE

    @property
    def start_action(self) -> str:
        """The name of the action that enters the automaton."""
        return f"start_{self.name}"
