"""Evaluate properties of any shape from the values of single operators, inside out.

Every operator inside another is solved first, in all states, and becomes a label, so that Storm gets one
operator over labels at a time; what reads variables alone is computed exactly from the valuations.

Axes: S states, I states that matter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.checker.checked_model import CheckedModel
from merap.checker.exchange import Answer
from merap.checker.filters import FilterParts, filter_parts, filtered
from merap.checker.operators import OPERATORS, OperatorReader, Query, solve, truths
from merap.checker.path_text import PathText, path_text
from merap.checker.property_expressions import expression, is_expression, number
from merap.checker.property_file import Node
from merap.checker.solving import Bound, Values, mean_answer
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.checker.value_arithmetic import ARITHMETIC, COMPARISONS, LOGICAL, call, compared, negative
from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.program.expressions import Expression, Kind, check, evaluate, substitute
from merap.program.names import suggestion


class Evaluator:
    """Evaluate properties of one model.

    Args:
        model: the model.
        place: names model and property in messages.
    """

    def __init__(self, model: CheckedModel, place: str) -> None:
        self._model, self._place = model, place
        self._reader = OperatorReader(model, self._label, self._number)
        self._all: Ints = np.arange(model.arrays.num_states)

    def answer(self, tree: Node, weights: Floats) -> Answer:
        """Answer a property.

        Args:
            tree: of the property.
            weights: float64 [S], the distribution over initial states.

        Raises:
            InputError: it names something unknown, or asks for a value inside another operator.
            UnsupportedPropertyError: it can't be answered, or not soundly.
            ModelError: fractions are needed, and give another model.
            EngineError: Storm failed.
        """
        try:
            return self._answer(tree, weights)
        except (InputError, UnsupportedPropertyError) as error:
            if str(error).startswith(self._place):
                raise
            raise type(error)(f"{self._place}: {error}") from error

    def _answer(self, tree: Node, weights: Floats) -> Answer:
        states = np.flatnonzero(weights)
        while tree.data == "brackets":
            tree = tree.children[0]
        if self._is_number(tree):
            return mean_answer(self.numbers(tree, states), weights, None)
        if tree.data in OPERATORS and not filter_parts(tree):
            values, met = self._bounded(tree, states)
            return mean_answer(values, weights, bool(met[states].all()))
        return Answer(holds=bool(self.truths(tree, states)[states].all()))

    def numbers(self, tree: Node, states: Ints) -> Values:
        """Evaluate a formula whose value is a number, where it matters; raises as `answer`."""
        if is_expression(tree):
            value = self._read(tree).astype(np.float64)
            return Values(value, value, value, exact=True)
        if (parts := filter_parts(tree)) is not None:
            return self._filtered_number(parts)
        if tree.data in OPERATORS:
            return solve(self._model, self._reader.read(tree), self._place, states)
        return self._computed(tree, states)

    def _computed(self, tree: Node, states: Ints) -> Values:
        """Evaluate arithmetic."""
        children = tree.children
        match tree.data:
            case "brackets":
                return self.numbers(children[0], states)
            case "strategy":
                self._by_some_policy(tree)
                return self.numbers(children[1], states)
            case "minus":
                return negative(self.numbers(children[0], states))
            case "call":
                return call(str(children[0]), [self.numbers(one, states) for one in children[1:]])
            case "binary" if str(children[1]) in ARITHMETIC:
                left, symbol, right = children
                return ARITHMETIC[str(symbol)](self.numbers(left, states), self.numbers(right, states))
        raise UnsupportedPropertyError("a value of this form is not supported")

    def truths(self, tree: Node, states: Ints) -> Bools:
        """Return bool [S], where a formula holds, right in the states that matter; raises as `answer`."""
        if is_expression(tree):
            found = self._read(tree)
            if found.dtype != np.bool_:
                raise InputError("a number stands where a truth value is expected")
            return found
        if (parts := filter_parts(tree)) is not None:
            return self._filtered_truth(parts)
        if tree.data in OPERATORS:
            return self._bounded(tree, states)[1]
        if (decide := _TRUTHS.get(tree.data)) is None:
            if tree.data == "multi":
                raise UnsupportedPropertyError("Storm has no single value for it with bounds: multi(..)")
            raise UnsupportedPropertyError("a path formula stands where states are meant")
        return decide(self, tree, states)

    def _in_brackets(self, tree: Node, states: Ints) -> Bools:
        return self.truths(tree.children[0], states)

    def _with_label(self, tree: Node, _: Ints) -> Bools:
        return self._labelled(str(tree.children[0]).strip('"'))

    def _negated(self, tree: Node, states: Ints) -> Bools:
        return ~self.truths(tree.children[1], states)

    def _chosen_side(self, tree: Node, states: Ints) -> Bools:
        condition, taken, other = (self.truths(one, states) for one in tree.children)
        return np.where(condition, taken, other)

    def _by_strategy(self, tree: Node, states: Ints) -> Bools:
        inner = tree.children[1]
        if inner.data not in OPERATORS:
            raise UnsupportedPropertyError("<<..>> stands before one operator")
        return self._bounded(inner, states, by_some_policy=self._by_some_policy(tree))[1]

    def _combined(self, tree: Node, states: Ints) -> Bools:
        left, symbol, right = tree.children
        if str(symbol) in COMPARISONS and self._is_number(left):
            found = compared(str(symbol), self.numbers(left, states), self.numbers(right, states), states)
            if found is None:
                raise UnsupportedPropertyError("two values are too close to be compared")
            return found
        return LOGICAL[str(symbol)](self.truths(left, states), self.truths(right, states))

    def _bounded(self, tree: Node, states: Ints, *, by_some_policy: bool = False) -> tuple[Values, Bools]:
        query = self._reader.read(tree, by_some_policy=by_some_policy)
        if query.bound is None:
            raise InputError("an operator inside another needs a bound, as P>=0.5 [..]")
        values = solve(self._model, query, self._place, states)
        return values, truths(self._model, query, values, self._place, states)

    def _quantified(self, tree: Node, states: Ints) -> Bools:
        """Decide `E [path]` and `A [path]` where a path of finite length is a witness, or against it."""
        letter, body = tree.children
        path = path_text(body, self._label, self._reader.steps)
        exists = str(letter) == "E"
        if path.delay or path.nested:
            raise UnsupportedPropertyError(f"{letter} of a path formula of this form is not supported")
        if exists != path.complement:
            found = self._some_path(path, "max", Bound(">", Fraction(0)), states)
            return found if exists else ~found
        if "U<=" in path.text or "U[" in path.text or path.text.startswith("X "):
            found = self._some_path(path, "min", Bound("<", Fraction(1)), states)
            return found if exists else ~found
        raise UnsupportedPropertyError(f"{letter} of a path without end is not supported")

    def _some_path(self, path: PathText, best: str, bound: Bound, states: Ints) -> Bools:
        query = Query("P", "" if self._model.is_chain else best, PathText(path.text), bound)
        values = solve(self._model, query, self._place, states)
        return truths(self._model, query, values, self._place, states)

    def _by_some_policy(self, tree: Node) -> bool:
        """Return whether `<<..>>` or `[[..]]` before an operator of an MDP means some policy, not all.

        `<<*>>` is all that there is, the one player; `[[C]]` is what all others are able to do.
        """
        bracket, *players = tree.children[0].children
        named = [str(one) for one in players if one is not None]
        able = str(bracket) == "<<"
        if named not in ([], ["*"]):
            raise UnsupportedPropertyError(
                "Storm has no single value for it with bounds: <<..>> of players; an MDP has one, <<*>>"
            )
        return able == bool(named)

    def _filtered_number(self, parts: FilterParts) -> Values:
        chosen = self._chosen(parts)
        if parts.operator == "count":
            met = self.truths(parts.formula, chosen)[chosen]
            return Values.constant(float(met.sum()), len(self._all))
        return filtered(parts.operator, self.numbers(parts.formula, chosen), chosen, len(self._all))

    def _filtered_truth(self, parts: FilterParts) -> Bools:
        chosen = self._chosen(parts)
        met = self.truths(parts.formula, chosen)[chosen]
        holds = met.any() if parts.operator in ("exists", "|") else met.all()
        return np.full(len(self._all), bool(holds))

    def _chosen(self, parts: FilterParts) -> Ints:
        chosen = self._all
        if parts.states is not None:
            chosen = np.flatnonzero(self.truths(parts.states, self._all))
        if len(chosen) == 0:
            raise InputError("no state is one that the filter asks for")
        if parts.operator in ("state", "first") and len(chosen) > 1:
            raise InputError(f"the filter asks for one state, and {len(chosen)} are meant")
        return chosen

    def _is_number(self, tree: Node) -> bool:
        """Return whether the value of a formula is a number, not a truth value."""
        if is_expression(tree):
            return self._read(tree).dtype != np.bool_
        if (parts := filter_parts(tree)) is not None:
            return parts.operator == "count" or (
                parts.operator not in ("forall", "exists", "&", "|") and self._is_number(parts.formula)
            )
        if tree.data in ("brackets", "strategy"):
            return self._is_number(tree.children[-1])
        if tree.data == "binary":
            return str(tree.children[1]) in ARITHMETIC
        return tree.data in ("minus", "call", "power") or (
            tree.data in OPERATORS and _condition(tree).data == "query"
        )

    def _label(self, tree: Node) -> str:
        while tree.data == "brackets":
            tree = tree.children[0]
        if tree.data == "label_name":
            name = str(tree.children[0]).strip('"')
            self._labelled(name)
            return name
        return self._model.label_of(self.truths(tree, self._all))

    def _labelled(self, name: str) -> Bools:
        labels = self._model.labels
        if name not in labels:
            raise InputError(f"unknown label {name!r}{suggestion(name, labels)}")
        return labels[name]

    def _number(self, tree: Node, what: str) -> Fraction:
        return number(tree, self._model.constants, what)

    def _read(self, tree: Node) -> npt.NDArray[Any]:
        """Evaluate what reads variables alone: float64 or bool [S]."""
        columns = self._model.columns
        found = expression(tree)
        for _ in range(len(self._model.definitions)):  # formulas may use others
            if (put_in := substitute(found, self._model.definitions)) == found:
                break
            found = put_in
        kinds: dict[str, Kind] = {
            name: "bool" if column.dtype == np.bool_ else "number" for name, column in columns.items()
        }
        values = evaluate(_checked(found, kinds), columns)
        return np.broadcast_to(values, (len(self._all),))


_TRUTHS: Mapping[str, Callable[[Evaluator, Node, Ints], Bools]] = {
    "brackets": Evaluator._in_brackets,
    "label_name": Evaluator._with_label,
    "unary": Evaluator._negated,
    "binary": Evaluator._combined,
    "choose": Evaluator._chosen_side,
    "quantified": Evaluator._quantified,
    "strategy": Evaluator._by_strategy,
}


def _checked(found: Expression, kinds: Mapping[str, Kind]) -> Expression:
    """Check names and types; any type is allowed for the whole."""
    try:
        check(found, kinds, "bool")
    except InputError:
        check(found, kinds, "number")
    return found


def _condition(tree: Node) -> Node:
    return next(one for one in tree.children if getattr(one, "data", None) in ("query", "threshold"))
