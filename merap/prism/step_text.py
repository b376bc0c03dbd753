"""Outcomes, conditions and rewards of single actions as PRISM expressions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from merap.concerns.combination import Combination, Condition, ExternalAction, InnateAction
from merap.concerns.expressions import Constant, Expression, Variable, exact, fold, render, render_constant
from merap.concerns.space import Attribute
from merap.mdp.model import Bools, Ints
from merap.prism.lines import Formula
from merap.prism.location_text import bare, cases, predicate


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
class Step:
    """An action and its ways to turn out, from one mode (None: whichever)."""

    action: str
    branches: tuple[Branch, ...]
    mode: int | None = None


class StepWriter:
    """Writes what a step means; remembers which formulas of attributes it needs."""

    def __init__(self, combination: Combination) -> None:
        self.combination = combination
        self.space = combination.space
        self._attributes: dict[str, str] = {}
        self._taken: set[str] = set()
        self._passable = combination.passable
        self._by_name = {attribute.name: attribute for attribute in combination.environment.attributes}

    def external(self, action: ExternalAction) -> Step:
        """An external action."""
        branches = [
            Branch(self.expression(outcome.probability, action.outcomes[0].move), move=outcome.move)
            for outcome in action.outcomes
            if outcome.probability != Constant(Fraction(0))
        ]
        return Step(action.name, tuple(branches))

    def innate(self, action: InnateAction) -> list[Step]:
        """An innate action, from each mode in which it is defined."""
        return [
            Step(
                action.name,
                tuple(Branch(render_constant(p), mode=successor) for successor, p in row.items() if p),
                mode,
            )
            for mode, row in action.transitions.items()
        ]

    def there(self, move: int | None) -> Ints:
        """int64 [P]: where a move leads from each location, itself where that is blocked."""
        here = np.arange(self.space.num_locations)
        if move is None:
            return here
        return np.where(self._passable[:, move], self.space.target[:, move], here)

    def expression(self, expression: Expression, move: int | None, mode: int | None = None) -> str:
        """An expression over a step along `move` into `mode`: a constant, a name, or in parentheses."""
        known = {"mode'": Fraction(mode)} if mode is not None else {}
        folded = fold(expression, known)
        text = render(folded, self._rename(move))
        return text if isinstance(folded, Constant | Variable) else f"({text})"

    def _rename(self, move: int | None) -> Callable[[str], str]:
        def rename(name: str) -> str:
            if name.rstrip("'") == "mode":
                return "mode"
            attribute = self._by_name[name.rstrip("'")]
            return self._attribute(attribute, move if name.endswith("'") else None)

        return rename

    def _attribute(self, attribute: Attribute, move: int | None) -> str:
        """The formula for an attribute here, or where `move` leads."""
        name = f"attribute_{attribute.name}" + ("" if move is None else f"_{self.space.moves[move]}")
        values = attribute.values[self.there(move)]
        if attribute.kind == "bool":
            self._attributes[name] = predicate(self.space, values != 0)
        else:
            unique, index = np.unique(values, return_inverse=True)
            self._attributes[name] = cases(self.space, [_number(value) for value in unique], index)
        return name

    def take_attributes(self) -> list[Formula]:
        """The formulas of attributes that were used and not taken before."""
        fresh = sorted(self._attributes.keys() - self._taken)
        self._taken |= self._attributes.keys()
        return [Formula(name, self._attributes[name]) for name in fresh]

    def mode_in(self, modes: Bools) -> str:
        """Membership of the mode in `modes` (bool [Q]): an atom, or in parentheses."""
        if modes.all():
            return "true"
        terms = [f"mode={mode}" for mode in np.flatnonzero(modes)]
        if len(terms) <= 1:
            return terms[0] if terms else "false"
        return f"({' | '.join(terms)})"

    def holds(self, condition: Condition, action: str, branch: Branch) -> str:
        """When `condition` holds of a step with that outcome: `true`, `false` or an expression."""
        if condition.actions is not None and action not in condition.actions:
            return "false"
        terms = []
        if condition.at is not None:
            terms.append(predicate(self.space, condition.at))
        if condition.to is not None:
            terms.append(predicate(self.space, condition.to[self.there(branch.move)]))
        if condition.modes is not None:
            terms.append(self.mode_in(condition.modes))
        if condition.to_modes is not None and branch.mode is not None:
            terms.append("true" if condition.to_modes[branch.mode] else "false")
        elif condition.to_modes is not None:
            terms.append(self.mode_in(condition.to_modes))
        if condition.where is not None:
            terms.append(self.expression(condition.where, branch.move, branch.mode))
        return conjunction(terms)

    def pay(self, steps: list[Step]) -> str:
        """The expected reward of an action: an atom, or in parentheses."""
        texts = [(step.mode, self._expected(step)) for step in steps]
        if len({text for _, text in texts}) == 1:
            return texts[0][1]
        chain = "".join(f"mode={mode} ? {text} : " for mode, text in texts[:-1])
        return f"({chain}{texts[-1][1]})"

    def _expected(self, step: Step) -> str:
        earned = [self._reward(step.action, branch) for branch in step.branches]
        if len(set(earned)) == 1:
            return earned[0]
        terms = [
            f"{branch.probability} * {f'({text})' if text.startswith('-') else text}"
            for branch, text in zip(step.branches, earned, strict=True)
        ]
        return f"({' + '.join(terms)})"

    def _reward(self, action: str, branch: Branch) -> str:
        """First match wins, no match earns 0."""
        chain, last = "", "0"
        for rule in self.combination.objective.rules:
            condition = self.holds(rule.condition, action, branch)
            value = self.expression(rule.value, branch.move, branch.mode)
            if condition == "true":
                last = value
                break
            if condition != "false":
                chain += f"{bare(condition)} ? {value} : "
        return f"({chain}{last})" if chain else last


def conjunction(terms: list[str]) -> str:
    """All of `terms`: `true`, `false`, an atom, or in parentheses."""
    if "false" in terms:
        return "false"
    real = [term for term in terms if term != "true"]
    if len(real) <= 1:
        return real[0] if real else "true"
    return f"({' & '.join(real)})"


def _number(value: float) -> str:
    return render_constant(exact(float(value)))
