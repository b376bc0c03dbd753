"""Read and solve the operators of properties: P, R, S, LRA, T, and E and A of paths.

Axes: S states, I states whose values matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, log
from typing import Any, cast

import numpy as np

from merap.checker.checked_model import CheckedModel
from merap.checker.path_text import PathText, path_text
from merap.checker.property_file import Node
from merap.checker.solving import TAIL, Bound, Values, approximate, exactly, holds_exactly
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.errors import InputError
from merap.mdp.csr import row_best
from merap.mdp.model import Bools, Ints
from merap.program.names import suggestion

OPERATORS = frozenset(("probability", "long_run", "reward"))
FRESH = 1e-15  # of a value in one step of ours: bounds are widened by it


@dataclass(frozen=True)
class Query:
    """One operator over labels.

    Attributes:
        head: letter and reward structure.
        best: `max` or `min`, empty for a Markov chain.
        path: what stands in its brackets.
        bound: None where the value is asked for.
        structure: name of the rewards that it sums up.
        discount: of a discounted sum without end.
        averages: whether it asks for a mean over all time.
    """

    head: str
    best: str
    path: PathText
    bound: Bound | None = None
    structure: str | None = None
    discount: Fraction | None = None
    averages: bool = False

    @property
    def text(self) -> str:
        """The query without its bound, as Storm reads it."""
        return f"{self.head}{self.best}=? [{self.path.text}]"

    def with_bound(self, bound: Bound) -> str:
        """Return the text of the query with a bound."""
        return f"{self.head}{self.best}{bound} [{self.path.text}]"


class OperatorReader:
    """Read operators over what has been labelled.

    Args:
        model: the model.
        label: returns the label of a state formula, which it solves first.
        number: computes a number from constants; its second argument names it in messages.
    """

    def __init__(
        self,
        model: CheckedModel,
        label: Callable[[Node], str],
        number: Callable[[Node, str], Fraction],
    ) -> None:
        self._model, self._label, self._number = model, label, number

    def read(self, tree: Node, *, by_some_policy: bool = False) -> Query:
        """Read an operator.

        Args:
            tree: of `probability`, `long_run` or `reward`.
            by_some_policy: a bound without direction is to hold for some policy, not for all.

        Raises:
            InputError: a bound is no number, or an MDP is asked for a value without `min` or `max`.
            UnsupportedPropertyError: the form is not supported.
        """
        structure = None
        if tree.data == "reward":
            letter, name, direction, condition, body, *filters = cast("list[Any]", tree.children)
            structure = self._structure(name and name.children[0]) if letter == "R" else None
        else:
            letter, direction, condition, body, *filters = cast("list[Any]", tree.children)
        assert not filters, "an old filter is taken off first"
        bound = self._bound(condition)
        head = f'R{{"{structure}"}}' if structure else str(letter)
        query = Query(
            "LRA" if letter == "S" else head,
            self._best(direction, bound, by_some_policy=by_some_policy),
            PathText(""),
            bound,
            structure,
        )
        if tree.data == "long_run":
            return replace(query, path=PathText(f'"{self._label(body)}"'), averages=True)
        if tree.data == "reward":
            return self._reward(query, body)
        path = path_text(body, self._label, self.steps)
        if path.complement:
            mirrored = {"max": "min", "min": "max"}.get(query.best, "")
            return replace(query, path=path, best=mirrored)
        return replace(query, path=path)

    def steps(self, tree: Node) -> int:
        """Compute a number of steps."""
        number = self._number(tree, "a number of steps")
        if number.denominator != 1:
            raise InputError(f"{number} is no whole number of steps")
        return int(number)

    def _bound(self, condition: Node) -> Bound | None:
        if condition.data == "query":
            return None
        comparison, threshold = condition.children
        return Bound(str(comparison), self._number(threshold, "a bound"))

    def _best(self, direction: str | None, bound: Bound | None, *, by_some_policy: bool) -> str:
        if self._model.is_chain:
            return ""
        if direction is not None:
            return str(direction)
        if bound is None:
            raise InputError("an MDP has a value for each policy: ask for the least or greatest, as Pmax=?")
        # for all policies: of values that are to be large the least one is compared
        return "max" if bound.asks_for_more == by_some_policy else "min"

    def _finite(self, structure: str) -> str:
        rewards = self._model.rewards(structure)
        if not np.isfinite(rewards).all():
            choice = self._model.arrays.describe_choice(int(np.flatnonzero(~np.isfinite(rewards))[0]))
            raise InputError(f"{choice} has no finite reward {structure!r}")
        return structure

    def _structure(self, given: str | None) -> str:
        known = self._model.structures
        if given is None or given[0] != '"':
            place = 1 if given is None else int(given)
            if not 1 <= place <= len(known):
                raise InputError(f"the model has {len(known)} reward structures")
            return self._finite(known[place - 1])
        name = given.strip('"')
        if name not in known:
            raise InputError(f"unknown reward model {name!r}{suggestion(name, known)}")
        return self._finite(name)

    def _reward(self, query: Query, body: Node) -> Query:
        while body.data == "brackets":
            body = body.children[0]
        if body.data == "long_run_reward":
            self._refuse_negative(query)
            return replace(query, path=PathText("LRA"), averages=True)
        if body.data == "instantaneous":
            return replace(query, path=PathText(f"I={self.steps(body.children[0])}"))
        if body.data == "cumulative":
            return self._cumulative(query, *body.children[1:])
        if body.data == "unary_path" and body.children[0] == "F" and body.children[1] is None:
            self._refuse_negative(query)
            return replace(query, path=PathText(f'F "{self._label(body.children[2])}"'))
        raise UnsupportedPropertyError("rewards of this path: expected [F states], [C], [C<=k], [I=k] or [S]")

    def _cumulative(self, query: Query, steps: Node | None, discount: Node | None) -> Query:
        factor = None if discount is None else self._number(discount.children[0], "a discount")
        if factor is not None and not 0 < factor < 1:
            raise InputError(f"a discount is between 0 and 1, not {float(factor):g}")
        if steps is None and factor is None:
            self._refuse_negative(query)
            return replace(query, path=PathText("C"))
        if steps is None:
            assert factor is not None
            count = ceil(log(TAIL * (1 - factor)) / log(factor))
        else:
            symbol, number = steps.children
            if symbol not in ("<=", "<"):
                raise UnsupportedPropertyError(f"[C{symbol}k] is not supported")
            count = max(0, self.steps(number) - (symbol == "<"))
        end = "" if factor is None else f"discount={factor}"
        path = PathText(f"C<={count}{end}")
        return replace(query, path=path, discount=factor if steps is None else None)

    def _refuse_negative(self, query: Query) -> None:
        if query.structure is not None and (self._model.rewards(query.structure) < 0).any():
            raise UnsupportedPropertyError(
                f"rewards {query.structure!r} are below 0 somewhere, and Storm sums up such rewards soundly "
                "only over a bounded number of steps; write [C<=k]"
            )


def solve(model: CheckedModel, query: Query, place: str, states: Ints) -> Values:
    """Solve a query, its bound left aside.

    Args:
        model: the model.
        query: what to solve.
        place: names model and property in messages.
        states: int64 [I], those whose values matter.

    Raises:
        UnsupportedPropertyError: Storm can't answer this kind.
        ModelError: fractions are needed, and give another model.
        EngineError: Storm failed.
    """
    needed = np.arange(model.arrays.num_states) if query.path.delay else states
    values = None if query.averages else approximate(model, query.text, place, needed)
    if values is None:
        values = exactly(model, query.text, place)
    if query.discount is not None:
        tail = TAIL * _largest_reward(model, query)
        values = Values(values.value, values.value - tail, values.value + tail)
    if query.path.delay:
        values = _delayed(model, values, query)
    if query.path.complement:
        values = Values(1 - values.value, 1 - values.upper, 1 - values.lower, values.exact)
    return values


def truths(model: CheckedModel, query: Query, values: Values, place: str, states: Ints) -> Bools:
    """Return bool [S], where the query's bound is met; raises as `solve`."""
    bound = query.bound
    assert bound is not None
    met = bound.clearly_met(values, states, _largest_reward(model, query))
    if met is not None:
        return met
    if query.path.delay or query.discount is not None:
        kind = "a discounted total" if query.discount is not None else "a lower bound on time alone"
        raise UnsupportedPropertyError(f"{kind} has a value too close to {bound.threshold} to be compared")
    if query.path.complement:
        bound = bound.of_complement()
    return holds_exactly(model, query.with_bound(bound), place)


def _largest_reward(model: CheckedModel, query: Query) -> float:
    return 0.0 if query.structure is None else float(np.abs(model.rewards(query.structure)).max(initial=0))


def _delayed(model: CheckedModel, values: Values, query: Query) -> Values:
    """Let the steps go by that a path has to take first."""
    mdp = model.arrays
    stay = np.ones(mdp.num_states, dtype=np.bool_)
    if query.path.stay is not None:
        stay = model.mask_of(query.path.stay)
    found = []
    for start in (values.value, values.lower, values.upper):
        current = start
        for _ in range(query.path.delay):
            best = row_best(mdp.transitions @ current, mdp.state_to_choice, maximise=query.best == "max")
            current = np.where(stay, best, 0.0)
        found.append(current)
    slack = query.path.delay * FRESH
    return Values(found[0], found[1] - slack, found[2] + slack)
