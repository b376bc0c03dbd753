"""Outcomes, conditions and rewards of single actions as PRISM expressions."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from merap.concerns.combination import Combination, Condition, ExternalAction, InnateAction, Outcome
from merap.concerns.expressions import (
    Constant,
    Expression,
    Operation,
    Variable,
    evaluate,
    exact,
    fold,
    render,
    render_constant,
)
from merap.concerns.space import Attribute
from merap.concerns.steps import scope_of
from merap.concerns.synthesis import NEGLIGIBLE
from merap.mdp.model import Bools, Ints
from merap.prism.engine_form import engine_form, is_table
from merap.prism.lines import Formula
from merap.prism.location_text import cases, predicate
from merap.prism.terms import alternatives, bare, condition_of, conjunction

_COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
# A comparison of two names or numbers, which reads best without spaces: mode=2.
_COMPARISON = re.compile(
    r"(?<![-+*/<=] )(?<![^=]> )\b([A-Za-z_]\w*) (!=|<=|>=|=|<|>) (-?\w+)\b(?!/| [-+*/<>=!])"
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
        """A probability; where arithmetic ends in 0 that is said, as engines round it to something else."""
        text = self.expression(outcome.probability, intended)
        form = self._form(outcome.probability, intended, None, None)
        if is_table(form):
            return text
        terms = [
            conjunction([predicate(self.space, mask), self.mode_in(modes)])
            for mask, modes in _groups_of_modes(self._negligible(form, intended))
        ]
        return f"({condition_of(alternatives(terms))} ? 0 : {text})" if terms else text

    def _negligible(self, form: Expression, intended: int | None) -> Bools:
        """bool [P, Q]: where external actions are possible and a probability is 0, but for rounding."""
        num_modes = len(self.combination.modes)
        terminal = np.flatnonzero(self.combination.capability.terminal(num_modes))
        here = np.repeat(np.arange(self.space.num_locations), len(terminal))
        mode = np.tile(terminal, self.space.num_locations)
        scope = scope_of(self.combination, here, mode, self.there(intended)[here], mode)
        prob = np.broadcast_to(evaluate(form, scope), here.shape)
        mask = np.zeros((self.space.num_locations, num_modes), dtype=np.bool_)
        mask[here, mode] = np.abs(prob) < NEGLIGIBLE
        other = np.setdiff1d(np.arange(num_modes), terminal)
        mask[:, other] = mask[:, terminal[:1]]  # of no importance there, so as elsewhere
        return mask

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
        form = self._form(expression, move, before, after)
        text = self._text(form, move)
        return text if isinstance(form, Constant | Variable) else f"({text})"

    def _form(
        self, expression: Expression, move: int | None, before: int | None, after: int | None
    ) -> Expression:
        known = {"mode": before, "mode'": before if after is None else after}
        folded = fold(expression, {name: Fraction(mode) for name, mode in known.items() if mode is not None})
        unchanged = {"mode'"} if move is not None else {"mode'", *(f"{name}'" for name in self._by_name)}
        return engine_form(_unprimed(folded, unchanged))

    def _text(self, form: Expression, move: int | None) -> str:
        return _COMPARISON.sub(r"\1\2\3", render(form, self._rename(move)))

    def _rename(self, move: int | None) -> Callable[[str], str]:
        def rename(name: str) -> str:
            if name == "mode":
                return "mode"
            attribute = self._by_name[name.rstrip("'")]
            return self._attribute(attribute, move if name.endswith("'") else None)

        return rename

    def _attribute(self, attribute: Attribute, move: int | None) -> str:
        """The name of the formula for an attribute here, or where `move` leads."""
        name = f"attribute_{attribute.name}" + ("" if move is None else f"_{self.space.moves[move]}")
        while self._names.setdefault(name, (attribute.name, move)) != (attribute.name, move):
            name += "_"  # another attribute and label make the same name
        if name in self._attributes:
            return name
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
        """When `condition` holds of a step: `true`, `false`, a comparison, or in parentheses.

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
            terms.append(self._truth(self._form(condition.where, branch.move, mode, after), branch.move))
        return conjunction(terms)

    def _truth(self, form: Expression, move: int | None) -> str:
        text = self._text(form, move)
        loose = isinstance(form, Operation) and form.operator not in _COMPARISONS
        return f"({text})" if loose else text

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
            chain += f"{condition_of(condition)} ? {condition_of(value)} : "
        return f"({chain}{condition_of(last)})" if chain else last


def _unprimed(expression: Expression, unchanged: Collection[str]) -> Expression:
    """Variables in `unchanged` without their prime."""
    if isinstance(expression, Variable) and expression.name in unchanged:
        return Variable(expression.name.removesuffix("'"), expression.column)
    if not isinstance(expression, Operation):
        return expression
    return Operation(
        expression.operator, tuple(_unprimed(argument, unchanged) for argument in expression.arguments)
    )


def _groups_of_modes(mask: Bools) -> list[tuple[Bools, Bools]]:
    """Non-empty sets of locations (bool [P]), each with the modes (bool [Q]) whose column of `mask` it is."""
    columns, index = np.unique(mask, axis=1, return_inverse=True)
    return [
        (column, index.reshape(-1) == position) for position, column in enumerate(columns.T) if column.any()
    ]


def _number(value: float) -> str:
    return render_constant(exact(float(value)))
