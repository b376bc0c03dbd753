"""Outcomes, conditions and rewards of single actions as PRISM expressions."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from merap.concerns.combination import Combination, Condition, ExternalAction, InnateAction, Outcome
from merap.concerns.expressions import (
    Constant,
    Expression,
    Variable,
    evaluate,
    exact,
    fold,
    render,
    render_constant,
)
from merap.concerns.space import Attribute
from merap.concerns.synthesis import NEGLIGIBLE, scope_of_pairs
from merap.mdp.model import Bools, Ints
from merap.prism.engine_form import engine_form
from merap.prism.lines import Formula
from merap.prism.location_text import bare, cases, condition_of, predicate

# A comparison of two names or numbers, which reads best without spaces: mode=2.
_COMPARISON = re.compile(r"(?<![-+*/] )\b([A-Za-z_]\w*) (!=|<=|>=|=|<|>) (-?\w+)\b(?!/| [-+*/])")


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
        self._names: dict[str, tuple[str, int | None]] = {}
        self._taken: set[str] = set()
        self._passable = combination.passable
        self._by_name = {attribute.name: attribute for attribute in combination.environment.attributes}

    def external(self, action: ExternalAction) -> Step:
        """An external action."""
        intended = action.outcomes[0].move
        branches = [
            Branch(self._probability(outcome, intended), move=outcome.move)
            for outcome in action.outcomes
            if outcome.probability != Constant(Fraction(0))
        ]
        return Step(action.name, tuple(branches))

    def _probability(self, outcome: Outcome, intended: int | None) -> str:
        """0 where all but a rest of rounding is 0, so that engines drop the outcome there."""
        text = self.expression(outcome.probability, intended)
        if isinstance(outcome.probability, Constant):
            return text
        scope = scope_of_pairs(self.combination, self.there(intended))
        prob = np.broadcast_to(evaluate(outcome.probability, scope), scope["mode"].shape)
        rest = ((prob != 0) & (np.abs(prob) < NEGLIGIBLE)).reshape(self.space.num_locations, -1)
        terms = [
            conjunction([predicate(self.space, mask), self.mode_in(modes)])
            for mask, modes in _groups_of_modes(rest)
        ]
        return f"({bare(alternatives(terms))} ? 0 : {text})" if terms else text

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

    def expression(
        self, expression: Expression, move: int | None, before: int | None = None, after: int | None = None
    ) -> str:
        """An expression over a step along `move`: a constant, a name, or in parentheses.

        Args:
            expression: over attributes and modes.
            move: index of the edge label the step goes along, None if it stays.
            before: the mode, if it is known.
            after: the successor mode, if it is known.
        """
        known = {"mode": before, "mode'": after}
        folded = fold(expression, {name: Fraction(mode) for name, mode in known.items() if mode is not None})
        form = engine_form(folded)
        text = _COMPARISON.sub(r"\1\2\3", render(form, self._rename(move)))
        return text if isinstance(form, Constant | Variable) else f"({text})"

    def _rename(self, move: int | None) -> Callable[[str], str]:
        def rename(name: str) -> str:
            if name.rstrip("'") == "mode":
                return "mode"
            attribute = self._by_name[name.rstrip("'")]
            return self._attribute(attribute, move if name.endswith("'") else None)

        return rename

    def _attribute(self, attribute: Attribute, move: int | None) -> str:
        """The name of the formula for an attribute here, or where `move` leads."""
        name = f"attribute_{attribute.name}" + ("" if move is None else f"_{self.space.moves[move]}")
        while self._names.setdefault(name, (attribute.name, move)) != (attribute.name, move):
            name += "_"  # another attribute and label make the same name
        values = attribute.values[self.there(move)]
        if attribute.kind == "bool":
            self._attributes[name] = bare(predicate(self.space, values != 0))
        else:
            unique, index = np.unique(values, return_inverse=True)
            self._attributes[name] = bare(cases(self.space, [_number(value) for value in unique], index))
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
        return alternatives([f"mode={mode}" for mode in np.flatnonzero(modes)])

    def holds(self, condition: Condition, action: str, branch: Branch, mode: int | None = None) -> str:
        """When `condition` holds of a step with that outcome: `true`, `false` or an expression.

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
            terms.append(self.expression(condition.where, branch.move, mode, after))
        return conjunction(terms)

    def _located(self, condition: Condition, move: int | None) -> str:
        mask = np.ones(self.space.num_locations, dtype=np.bool_)
        if condition.at is not None:
            mask &= condition.at
        if condition.to is not None:
            mask &= condition.to[self.there(move)]
        return predicate(self.space, mask)

    def _in_modes(self, allowed: Bools | None, mode: int | None) -> str:
        if allowed is None:
            return "true"
        return self.mode_in(allowed if mode is None else np.full_like(allowed, allowed[mode]))

    def pay(self, steps: list[Step]) -> str:
        """The expected reward of an action: an atom, or in parentheses."""
        texts = [(step.mode, self._expected(step)) for step in steps]
        if len({text for _, text in texts}) == 1:
            return texts[0][1]
        chain = "".join(f"mode={mode} ? {text} : " for mode, text in texts[:-1])
        return f"({chain}{texts[-1][1]})"

    def _expected(self, step: Step) -> str:
        earned = [self._reward(step, branch) for branch in step.branches]
        if len(set(earned)) == 1:
            return earned[0]
        terms = [
            f"{branch.probability} * {f'({text})' if text.startswith('-') else text}"
            for branch, text in zip(step.branches, earned, strict=True)
            if text != "0"
        ]
        return f"({' + '.join(terms)})"

    def _reward(self, step: Step, branch: Branch) -> str:
        """First match wins, no match earns 0."""
        after = step.mode if branch.mode is None else branch.mode
        chain, last = "", "0"
        for rule in self.combination.objective.rules:
            condition = self.holds(rule.condition, step.action, branch, step.mode)
            if condition == "false":
                continue
            value = self.expression(rule.value, branch.move, step.mode, after)
            if condition == "true":
                last = value
                break
            chain += f"{condition_of(condition)} ? {value} : "
        return f"({chain}{last})" if chain else last


def _groups_of_modes(mask: Bools) -> list[tuple[Bools, Bools]]:
    """Non-empty sets of locations (bool [P]), each with the modes (bool [Q]) whose column of `mask` it is."""
    columns, index = np.unique(mask, axis=1, return_inverse=True)
    return [
        (column, index.reshape(-1) == position) for position, column in enumerate(columns.T) if column.any()
    ]


def alternatives(terms: list[str]) -> str:
    """Any of `terms`: `false`, an atom, or in parentheses."""
    if len(terms) <= 1:
        return terms[0] if terms else "false"
    return f"({' | '.join(terms)})"


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
