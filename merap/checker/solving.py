"""Solve flat properties soundly: in doubles where their error does not matter, else in fractions.

A flat property is one operator over labels. Storm's iterations in doubles end when their bounds meet,
which they never do on a slowly mixing model; their number is limited, and whatever has not met by then
is solved in fractions. Limiting them also limits what rounding adds up to.

Axes: S states, I states whose values are asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
import stormpy
from stormpy.exceptions import StormError

from merap.checker.exchange import Answer
from merap.checker.storm_messages import UnsupportedPropertyError, translate
from merap.errors import EngineError, InputError, MerapError
from merap.mdp.model import Bools, Floats, Ints

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


@dataclass(frozen=True, eq=False)
class Values:
    """Values of states with sound bounds; where none were asked for, they mean nothing.

    Attributes:
        value: float64 [S].
        lower: float64 [S]; NaN where there is no bound.
        upper: float64 [S]; NaN where there is no bound.
        exact: computed in fractions; then rounded once.
    """

    value: Floats
    lower: Floats
    upper: Floats
    exact: bool = False

    def mapped(self, function: Any) -> Values:
        """Return the values under a rising function, such as `np.floor`."""
        return Values(function(self.value), function(self.lower), function(self.upper), self.exact)

    @staticmethod
    def constant(value: float, size: int) -> Values:
        """Return one known value for every state."""
        array = np.full(size, value)
        return Values(array, array, array, exact=True)


@dataclass(frozen=True)
class Bound:
    """The bound that a formula compares its value with.

    Attributes:
        comparison: `<`, `<=`, `>` or `>=`.
        threshold: exact.
    """

    comparison: str
    threshold: Fraction

    @property
    def asks_for_more(self) -> bool:
        """Tell whether greater values meet the bound."""
        return self.comparison.startswith(">")

    def of_complement(self) -> Bound:
        """Return the bound that 1 - v meets where v meets this one."""
        mirrored = self.comparison.translate(str.maketrans("<>", "><"))
        return Bound(mirrored, 1 - self.threshold)

    def clearly_met(self, values: Values, states: Ints, largest: float) -> Bools | None:
        """Return bool [S], who meets it; None if a value is too close to tell.

        Args:
            values: of all states.
            states: int64 [I], those that matter.
            largest: the largest absolute reward that the values sum up.
        """
        threshold = float(self.threshold)
        distance = np.abs(values.value[states] - threshold)
        if not np.all(distance > TOO_CLOSE * max(1.0, abs(threshold), largest)):
            return None
        met: Bools = (values.value > threshold) == self.asks_for_more
        return met

    def __str__(self) -> str:
        return f"{self.comparison}{self.threshold}"


def approximate(models: Models, formula: str, place: str, states: Ints) -> Values | None:
    """Solve a query in doubles; None where the bounds of a state have not met, or there are none.

    Args:
        models: the model.
        formula: as `Pmax=? [F "goal"]`.
        place: names model and property in messages.
        states: int64 [I], those whose values are needed.

    Raises:
        UnsupportedPropertyError: Storm can't answer this kind.
        EngineError: Storm failed.
    """
    result = _run(models.model, formula, place)
    if not (result.has_lower_bounds() and result.has_upper_bounds()):
        return None
    values = Values(
        np.array(result.get_value_vector(), dtype=np.float64),
        np.array(result.get_lower_bound_vector(), dtype=np.float64),
        np.array(result.get_upper_bound_vector(), dtype=np.float64),
    )
    value, lower, upper = values.value[states], values.lower[states], values.upper[states]
    with np.errstate(invalid="ignore"):
        narrow = (lower == upper) | (upper - lower <= WIDTH * np.maximum(1, np.abs(value)))
    return values if np.all(narrow & (lower <= value) & (value <= upper)) else None


def exactly(models: Models, formula: str, place: str) -> Values:
    """Solve a query in fractions; the bounds that Storm states beside them are not always of the same value.

    Raises:
        ModelError: the model is another one in fractions.
        UnsupportedPropertyError: Storm can't answer this kind.
        EngineError: Storm failed.
    """
    result = _run(models.exact, formula, place)
    value = np.array([float(one) for one in result.get_value_vector()])
    known = result.has_lower_bounds() and result.has_upper_bounds()
    bound = value if known else np.full(len(value), np.nan)
    return Values(value, bound, bound, exact=True)


def holds_exactly(models: Models, formula: str, place: str) -> Bools:
    """Return bool [S], where a property with a bound holds, in fractions; raises as `exactly`."""
    result = _run(models.exact, formula, place)
    met = np.zeros(models.exact.nr_states, dtype=np.bool_)
    met[list(result.get_truth_values_vector())] = True
    return met


def _run(model: Any, formula: str, place: str) -> Any:
    environment = stormpy.environments.default(model)
    if not model.is_exact:
        for solver in (environment.solver().min_max(), environment.solver().native()):
            solver.precision = stormpy.Rational(PRECISION)
            solver.maximal_number_of_iterations = MAX_ITERATIONS
    with translated(place, model=model):
        parsed = stormpy.parse_properties(formula)[0].get_raw_formula()
        result = stormpy.model_checking(model, parsed, environment=environment)
    if result is None or result.is_pareto_curve_check_result():
        raise UnsupportedPropertyError(f"{place}: Storm has no single value for it")
    return result


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


def mean_answer(values: Values, weights: Floats, holds: bool | None) -> Answer:
    """Return the mean over the initial states; infinite where the value of one is."""
    states = np.flatnonzero(weights)
    mean, lower, upper = (
        float(weights[states] @ column[states]) for column in (values.value, values.lower, values.upper)
    )
    return Answer(
        mean,
        None if np.isnan(lower) else lower,
        None if np.isnan(upper) else upper,
        holds,
        exact=values.exact,
        least=float(values.value[states].min()),
        greatest=float(values.value[states].max()),
    )
