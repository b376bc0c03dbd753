"""Answer a property soundly: in doubles where their error does not matter, else in exact arithmetic.

Storm's iterations in doubles end when their bounds meet, which they never do on a slowly mixing
model; their number is limited, and whatever has not met by then is solved in fractions. Limiting
them also limits what rounding adds up to. Everything below the root of a property decides a
truth value that is used at once, without bounds, so such a property is checked in fractions alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil, log
from typing import Any, NamedTuple, Protocol

import stormpy
from stormpy.exceptions import StormError
from stormpy.logic import (
    ComparisonType,
    DiscountedTotalRewardFormula,
    LongRunAverageOperatorFormula,
    LongRunAverageRewardFormula,
    OperatorFormula,
    OptimizationDirection,
)

from merap.checker.exchange import Answer
from merap.checker.formulas import count_operators, count_queries, other_logic, unbounded_rewards
from merap.checker.storm_messages import UnsupportedPropertyError, translate
from merap.errors import EngineError, InputError, MerapError
from merap.mdp.model import Floats

PRECISION = "1/1000000000000"
MAX_ITERATIONS = 100_000
WIDTH = 1e-9  # of a value's bounds, relative from 1 on; wider ones have not met
TOO_CLOSE = 1e-6  # to a threshold, relative from 1 on, to decide by doubles
TAIL = 1e-13  # left out of a discounted sum, relative to its largest reward


class Models(Protocol):
    """One model, with probabilities and rewards in doubles and in fractions."""

    @property
    def model(self) -> Any:
        """stormpy's sparse model in doubles."""

    @property
    def exact(self) -> Any:
        """stormpy's sparse model in fractions, its states in the same order."""

    def rewards(self, structure: str | None) -> Floats | None:
        """Return float64 [C], the reward of each choice; None if there is no such structure."""


class _Value(NamedTuple):
    """The value in one state, with the engine's bounds."""

    value: float
    lower: float | None
    upper: float | None


def answer(models: Models, formula: Any, place: str, weights: Floats) -> Answer:
    """Answer a property.

    Args:
        models: the model.
        formula: stormpy's formula.
        place: names model and property in messages.
        weights: float64 [I], of the initial states.

    Raises:
        InputError: the property names something unknown, or asks for a value inside another.
        UnsupportedPropertyError: Storm can't answer this kind, or not soundly.
        ModelError: fractions are needed, and give another model.
        EngineError: Storm failed.
    """
    text = str(formula)
    _refuse_unsound(models, text, place)
    if not isinstance(formula, OperatorFormula):
        model = models.exact if count_operators(text) else models.model
        return Answer(holds=_holds_everywhere(model, formula, place))
    if count_queries(text) > (not formula.has_bound):
        raise InputError(f"{place}: an operator inside another needs a bound, as P>=0.5 [..]")
    plain = count_operators(text) == 1
    quantity = _without_bound(formula) if formula.has_bound else formula
    values = _approximate(models, quantity, place) if plain else None
    clear = values is not None and formula.has_bound and _is_clear(models, formula, values)
    if values is None:
        values = _exact(models.exact, quantity, place)
    holds = None
    if clear:
        holds = all(_meets(formula, value.value) for value in values)
    elif formula.has_bound:
        holds = _holds_everywhere(models.exact, formula, place)
    value, lower, upper = (_mean(weights, column) for column in zip(*values, strict=True))
    return Answer(value, lower, upper, holds)


def _refuse_unsound(models: Models, text: str, place: str) -> None:
    """Refuse what Storm answers wrongly, or never, wherever it stands in the property."""
    if (logic := other_logic(text)) is not None:
        raise UnsupportedPropertyError(f"{place}: Storm has no single value for it with bounds: {logic}")
    for structure in unbounded_rewards(text):
        rewards = models.rewards(structure)
        if rewards is not None and (rewards < 0).any():
            raise UnsupportedPropertyError(
                f"{place}: rewards {structure or ''!r} are below 0 somewhere, and Storm sums up such rewards "
                "soundly only over a bounded number of steps; write [C<=k]"
            )


def _without_bound(formula: Any) -> Any:
    """Ask for the bounded value: the least for `P>=p`, which is about every policy, else the greatest."""
    quantity = formula.clone()
    quantity.remove_bound()
    if not quantity.has_optimality_type:
        quantity.set_optimality_type(
            OptimizationDirection.MINIMIZE if _asks_for_more(formula) else OptimizationDirection.MAXIMIZE
        )
    return quantity


def _asks_for_more(formula: Any) -> bool:
    return formula.comparison_type in (ComparisonType.GEQ, ComparisonType.GREATER)


def _approximate(models: Models, quantity: Any, place: str) -> list[_Value] | None:
    """Return values in doubles in the initial states; None where their bounds have not met, or can't."""
    if isinstance(quantity, LongRunAverageOperatorFormula):
        return None
    if isinstance(quantity.subformula, LongRunAverageRewardFormula):
        return None
    if isinstance(quantity.subformula, DiscountedTotalRewardFormula):
        return _discounted_total(models, quantity, place)
    result = _run(models.model, quantity, place)
    bounds = [(state, result[state]) for state in models.model.initial_states]
    values = [_Value(result.get_value(state), bound.lower, bound.upper) for state, bound in bounds]
    return values if all(map(_have_met, values)) else None


def _have_met(value: _Value) -> bool:
    if value.lower is None or value.upper is None or not value.lower <= value.value <= value.upper:
        return False
    return value.lower == value.upper or value.upper - value.lower <= WIDTH * max(1, abs(value.value))


def _discounted_total(models: Models, quantity: Any, place: str) -> list[_Value]:
    """Rewrite a discounted sum without end as one over enough steps to leave next to nothing out."""
    with translated(place, model=models.model):
        discount = quantity.subformula.discount_factor_double
    steps = ceil(log(TAIL * (1 - discount)) / log(discount))
    text = str(quantity).replace("[Cdiscount=", f"[C<={steps}discount=")
    result = _run(models.model, stormpy.parse_properties(text)[0].get_raw_formula(), place)
    tail = TAIL * _largest_reward(models, quantity)
    values = [result.get_value(state) for state in models.model.initial_states]
    return [_Value(value, value - tail, value + tail) for value in values]


def _largest_reward(models: Models, formula: Any) -> float:
    """Return the largest absolute reward that a property sums up; 0 where it sums up none."""
    if not formula.is_reward_operator_formula:
        return 0
    rewards = models.rewards(formula.reward_name if formula.has_reward_model_name() else None)
    return 0 if rewards is None else float(abs(rewards).max(initial=0))


def _is_clear(models: Models, formula: Any, values: list[_Value]) -> bool:
    """Whether all values are further from the threshold than any error of theirs."""
    threshold = _threshold(formula)
    margin = TOO_CLOSE * max(1, abs(threshold), _largest_reward(models, formula))
    return all(abs(value.value - threshold) > margin for value in values)


def _meets(formula: Any, value: float) -> bool:
    return (value > _threshold(formula)) == _asks_for_more(formula)


def _threshold(formula: Any) -> float:
    """Return the threshold as a float; stormpy's own rational divides integers as integers, 1/2 to 0."""
    return float(formula.threshold_expr.evaluate_as_double())


def _exact(model: Any, quantity: Any, place: str) -> list[_Value]:
    """Return values in fractions; the bounds Storm states beside them are not always of the same value."""
    result = _run(model, quantity, place)
    values = []
    for state in model.initial_states:
        value = float(result.get_value(state))
        bound = None if result[state].lower is None or result[state].upper is None else value
        values.append(_Value(value, bound, bound))
    return values


def _holds_everywhere(model: Any, formula: Any, place: str) -> bool:
    result = _run(model, formula, place)
    return all(bool(result[state]) for state in model.initial_states)


def _run(model: Any, formula: Any, place: str) -> Any:
    environment = stormpy.environments.default(model)
    if not model.is_exact:
        for solver in (environment.solver().min_max(), environment.solver().native()):
            solver.precision = stormpy.Rational(PRECISION)
            solver.maximal_number_of_iterations = MAX_ITERATIONS
    with translated(place, model=model):
        result = stormpy.model_checking(model, formula, environment=environment)
    if result is None or result.is_pareto_curve_check_result():
        raise UnsupportedPropertyError(f"{place}: Storm has no single value for it")
    return result


def _mean(weights: Floats, values: tuple[float | None, ...]) -> float | None:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    return float(
        sum(weight * value for weight, value in zip(weights.tolist(), known, strict=True) if weight > 0)
    )


@contextmanager
def translated(place: str, user_error: type[MerapError] = InputError, model: Any = None) -> Iterator[None]:
    """Raise Storm's plain RuntimeErrors as errors of ours.

    Args:
        place: the model, or the model and its property.
        user_error: the kind where it is the text of the model or property that is wrong.
        model: given where a property of it is checked.
    """
    known = None
    if model is not None:
        known = {"label": sorted(model.labeling.get_labels()), "reward model": sorted(model.reward_models)}
    try:
        yield
    except (RuntimeError, StormError) as error:
        raise translate(str(error), place, user_error, known) from error
    except MemoryError as error:
        raise EngineError(f"{place}: Storm ran out of memory") from error
