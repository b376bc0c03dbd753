"""Outcomes, conditions and rewards of single actions as PRISM expressions."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from merap.concerns.combination import Combination, Condition, ExternalAction, InnateAction
from merap.mdp.model import Bools
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.prism.formulas import Formulas
from merap.prism.location_text import predicate
from merap.prism.terms import alternatives, condition_of, conjunction
from merap.program.expressions import (
    Constant,
    render_constant,
)


@dataclass(frozen=True)
class Branch:
    """One way an action can turn out.

    Attributes:
        probability: PRISM text, a constant or in parentheses.
        move: index of the edge label, None if the location stays.
        mode: the successor mode, None if the mode stays.
    """

    probability: str
    move: int | None = None
    mode: int | None = None


@dataclass(frozen=True)
class StepText:
    """An action and its ways to turn out, from one mode (None: whichever)."""

    action: str
    branches: tuple[Branch, ...]
    mode: int | None = None


class StepWriter:
    """Writes what a step means; `formulas` are those of attributes that its texts need."""

    def __init__(self, combination: Combination) -> None:
        self.combination = combination
        self.space = combination.space
        self.formulas = Formulas(combination)

    def external(self, action: ExternalAction) -> StepText:
        """An external action."""
        intended = action.outcomes[0].move
        branches = [
            Branch(self.formulas.probability(outcome.probability, intended), move=outcome.move)
            for outcome in action.outcomes
            if outcome.probability != Constant(Fraction(0))
        ]
        return StepText(action.name, tuple(branches))

    def innate(self, action: InnateAction) -> list[StepText]:
        """An innate action, from each mode in which it is defined."""
        return [
            StepText(
                action.name,
                tuple(Branch(render_constant(p), mode=successor) for successor, p in row.items() if p),
                mode,
            )
            for mode, row in action.transitions.items()
        ]

    def mode_in(self, modes: Bools) -> str:
        """Membership of the mode in `modes` (bool [Q]): an atom, or in parentheses."""
        if modes.all():
            return "true"
        return alternatives([f"{MODE_VARIABLE}={mode}" for mode in np.flatnonzero(modes)])

    def holds(self, condition: Condition, action: str, branch: Branch, mode: int | None = None) -> str:
        """Write when `condition` holds of a step: `true`, `false`, a comparison, or in parentheses.

        Args:
            condition: over the step.
            action: what is done.
            branch: how it turns out.
            mode: the mode it begins in, if it is known.
        """
        if condition.actions is not None and action not in condition.actions:
            return "false"
        after = mode if branch.mode is None else branch.mode
        terms = [
            self._located(condition, branch.move),
            self._in_modes(condition.modes, mode),
            self._in_modes(condition.to_modes, after),
        ]
        if condition.where is not None and "false" not in terms:
            terms.append(self.formulas.truth(condition.where, branch.move, mode, after))
        return conjunction(terms)

    def _located(self, condition: Condition, move: int | None) -> str:
        mask = np.ones(self.space.num_locations, dtype=np.bool_)
        if condition.at is not None:
            mask &= condition.at
        if condition.to is not None:
            mask &= condition.to[self.formulas.there(move)]
        return predicate(self.space, mask)

    def _in_modes(self, allowed: Bools | None, mode: int | None) -> str:
        if allowed is None:
            return "true"
        return self.mode_in(allowed if mode is None else np.full_like(allowed, allowed[mode]))

    def pay(self, steps: list[StepText]) -> str:
        """The expected reward of an action: an atom, or in parentheses."""
        texts = [(step.mode, self._expected(step)) for step in steps]
        if len({text for _, text in texts}) == 1:
            return texts[0][1]
        chain = "".join(f"{MODE_VARIABLE}={mode} ? {text} : " for mode, text in texts[:-1])
        return f"({chain}{texts[-1][1]})"

    def _expected(self, step: StepText) -> str:
        earned = [self._reward(step, branch) for branch in step.branches]
        if len(set(earned)) == 1:
            return earned[0]
        terms = [
            f"{branch.probability} * {f'({text})' if text.startswith('-') else text}"
            for branch, text in zip(step.branches, earned, strict=True)
            if text != "0"
        ]
        return f"({' + '.join(terms)})"

    def _reward(self, step: StepText, branch: Branch) -> str:
        """First match wins, no match earns 0."""
        after = step.mode if branch.mode is None else branch.mode
        chain, last = "", "0"
        for rule in self.combination.objective.rules:
            condition = self.holds(rule.condition, step.action, branch, step.mode)
            if condition == "false":
                continue
            value = self.formulas.number(rule.value, branch.move, step.mode, after)
            if condition == "true":
                last = value
                break
            chain += f"{condition_of(condition)} ? {condition_of(value)} : "
        return f"({chain}{condition_of(last)})" if chain else last
