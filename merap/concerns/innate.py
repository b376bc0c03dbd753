"""The innate automaton of a system (Definition 2 of the paper)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

from merap.concerns.document import KeyPath
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import TRUE, ZERO, Constant, Expression


@dataclass(frozen=True, repr=False)
class InnateAction(ShortRepr):
    """A row of delta: mode -> {successor mode: probability}; undefined elsewhere.

    The probabilities are numbers as soon as the parameters of the capability have values.
    """

    name: str
    transitions: Mapping[int, Mapping[int, Expression]]

    def mapped(self, change: Callable[[Expression], Expression]) -> InnateAction:
        """Return the action with every expression changed."""
        rows = {
            mode: {successor: change(chance) for successor, chance in row.items()}
            for mode, row in self.transitions.items()
        }
        return InnateAction(self.name, rows)

    @property
    def chances(self) -> dict[int, dict[int, Fraction]]:
        """The probabilities as numbers, those above 0."""
        return {
            mode: {
                successor: Fraction(chance.value)
                for successor, chance in row.items()
                if isinstance(chance, Constant) and chance != ZERO
            }
            for mode, row in self.transitions.items()
        }


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

    def mapped(self, change: Callable[[KeyPath, Expression], Expression]) -> Innate:
        """Return the automaton with every expression changed, given where the case file has it."""
        path = ("capability", "innate")
        actions = (one.mapped(partial(change, (*path, "actions", one.name))) for one in self.actions)
        return replace(self, actions=tuple(actions), requires=change((*path, "requires"), self.requires))
