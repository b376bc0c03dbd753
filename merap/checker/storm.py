"""Storm through stormpy: parse, build, check, export. The only importer of stormpy.

Storm accepts broken models by default: sums below 1, values past their range, deadlocks. Here
they are refused, with the state they occur in.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import stormpy
from stormpy.developer import LogLevel, set_log_level
from stormpy.developer.info import StormVersion
from stormpy.exceptions import StormError
from stormpy.logic import ComparisonType, OperatorFormula, OptimizationDirection, RewardOperatorFormula
from stormpy.models import ModelType

from merap.checker.storm_messages import UnsupportedPropertyError, translate
from merap.errors import EngineError, InputError, MerapError, ModelError
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.umb import read_umb

PRECISION = "1/1000000000000"
OUT_OF_BOUNDS = "out_of_bounds"
DEADLOCK = "deadlock"
_FILTER = re.compile(r'\s*("[^"]*"\s*:)?\s*filter\s*\(')
_BOUNDED_REWARDS = (
    stormpy.logic.CumulativeRewardFormula,
    stormpy.logic.DiscountedCumulativeRewardFormula,
    stormpy.logic.DiscountedTotalRewardFormula,
    stormpy.logic.InstantaneousRewardFormula,
)

set_log_level(LogLevel.OFF)  # it writes to standard output what it raises anyway


@dataclass(frozen=True)
class Answer:
    """What a model checker says of one property in the initial states.

    Attributes:
        value: the expected value over the initial distribution, of a property with a bound
            that of the same property without; None for a truth value alone.
        lower: sound lower bound of `value`; None if the engine gives none.
        upper: sound upper bound of `value`; None if the engine gives none.
        holds: whether it is true in every initial state; None if it asks for a value.
    """

    value: float | None
    lower: float | None
    upper: float | None
    holds: bool | None


@dataclass(frozen=True, eq=False)
class StormModel:
    """A sound model that Storm has built; it does not pickle.

    Attributes:
        source: what it was built from, for messages.
        program: stormpy's program, which properties refer to.
        model: stormpy's sparse model.
    """

    source: str
    program: Any
    model: Any

    def check(self, text: str, initial: Floats | None = None) -> Answer:
        """Check a property.

        Args:
            text: in PRISM's syntax, as `Pmax=? [F "goal"]`.
            initial: float64 [S], distribution over this model's states; by default uniform
                over its initial states.

        Raises:
            InputError: the property can't be parsed or names something unknown.
            UnsupportedPropertyError: Storm can't answer this kind, or not soundly.
            EngineError: Storm failed.
        """
        place = f"{self.source}: property {text!r}"
        formula = _parse_property(text, self.program, self.model, place)
        self._refuse_unsound(formula, place)
        answer = self._answer(self._run(formula, place), initial)
        if answer.holds is None or not (isinstance(formula, OperatorFormula) and formula.has_bound):
            return answer
        quantity = self._answer(self._run(_without_bound(formula), place), initial)
        return replace(quantity, holds=answer.holds)

    def _refuse_unsound(self, formula: Any, place: str) -> None:
        """Storm's answers about unbounded sums of rewards below 0 are wrong, or never come."""
        if not isinstance(formula, RewardOperatorFormula) or isinstance(formula.subformula, _BOUNDED_REWARDS):
            return
        structures = self.model.reward_models
        name = formula.reward_name if formula.has_reward_model_name() else next(iter(structures), "")
        if name in structures and np.any(self.mdp(name).choice_reward < 0):
            raise UnsupportedPropertyError(
                f"{place}: rewards {name!r} are below 0 somewhere, and Storm sums up such rewards soundly "
                "only over a bounded number of steps; write [C<=k]"
            )

    def _run(self, formula: Any, place: str) -> Any:
        environment = stormpy.environments.default(self.model)
        environment.solver().min_max().precision = stormpy.Rational(PRECISION)
        with _translated(place, model=self.model):
            result = stormpy.model_checking(self.model, formula, environment=environment)
        if result is None or result.is_pareto_curve_check_result():
            raise UnsupportedPropertyError(f"{place}: Storm has no single value for it")
        return result

    def _answer(self, result: Any, initial: Floats | None) -> Answer:
        states = list(self.model.initial_states)
        if result.is_qualitative():
            return Answer(None, None, None, all(bool(result[state]) for state in states))
        weights = [1 / len(states)] * len(states) if initial is None else initial[states].tolist()
        bounds = [result[state] for state in states]
        return Answer(
            value=_mean(weights, [result.get_value(state) for state in states]),
            lower=_mean(weights, [bound.lower for bound in bounds]),
            upper=_mean(weights, [bound.upper for bound in bounds]),
            holds=None,
        )

    def export_umb(self, path: Path) -> None:
        """Write the model as an uncompressed UMB archive.

        Raises:
            EngineError: Storm can't write it.
        """
        options = stormpy.io.UmbExportOptions()
        options.compression = stormpy.io.CompressionMode.NO_COMPRESSION
        with _translated(self.source, EngineError):
            stormpy.io.umb_to_archive(
                stormpy.io.sparse_model_to_umb(self.model, options=options), path, options
            )

    def mdp(self, reward: str | None = "objective") -> TabularMDP:
        """The model as arrays, through a UMB archive that is mapped into memory.

        Args:
            reward: the reward structure to take; None for rewards of 0.

        Raises:
            ModelError: the model breaks an invariant of `TabularMDP`.
        """
        with tempfile.TemporaryDirectory(prefix="merap-") as folder:
            path = Path(folder) / "model.umb"
            self.export_umb(path)
            try:
                return read_umb(path, reward=reward)
            except ModelError as error:
                raise ModelError(f"{self.source}: {error.__cause__ or error}") from error


def _mean(weights: list[float], values: list[Any]) -> float | None:
    if any(value is None for value in values):
        return None
    return sum(weight * float(value) for weight, value in zip(weights, values, strict=True))


def _parse_property(text: str, program: Any, model: Any, place: str) -> Any:
    if _FILTER.match(text):
        raise UnsupportedPropertyError(
            f"{place}: filters are not supported, values are of the initial states"
        )
    with _translated(place, model=model):
        parsed = stormpy.parse_properties(text, program)
    if len(parsed) != 1:
        raise InputError(f"{place}: holds {len(parsed)} properties, expected 1")
    if parsed[0].contains_undefined_constants():
        raise InputError(f"{place}: a constant has no value")
    return parsed[0].get_raw_formula()


def _without_bound(formula: Any) -> Any:
    """`P>=p` asks of every policy, so it is about the least value; `P<=p` about the greatest."""
    lower_bound = formula.comparison_type in (ComparisonType.GEQ, ComparisonType.GREATER)
    quantity = formula.clone()
    quantity.remove_bound()
    if not quantity.has_optimality_type:
        quantity.set_optimality_type(
            OptimizationDirection.MINIMIZE if lower_bound else OptimizationDirection.MAXIMIZE
        )
    return quantity


def version() -> str:
    """Storm's own version, as `2.0.0`."""
    return str(StormVersion.short_version_string())


def build_text(text: str, source: str) -> StormModel:
    """Parse and build PRISM text.

    Args:
        text: an MDP or a discrete-time Markov chain.
        source: its name in messages.

    Raises:
        InputError: a syntax error, another kind of model, or a constant without value.
        ModelError: a deadlock, a value out of its range, probabilities that do not sum to 1, or
            choices that actions do not tell apart; names state and action.
        EngineError: Storm can't build it.
    """
    with tempfile.TemporaryDirectory(prefix="merap-") as folder:
        path = Path(folder) / "model.prism"
        path.write_text(text, encoding="utf-8")
        return _build(path, source)


def build_file(path: Path) -> StormModel:
    """Parse and build a file of PRISM text; raises as `build_text`."""
    if not path.is_file():
        raise InputError("there is no such file", source=str(path))
    return _build(path, str(path))


def _build(path: Path, source: str) -> StormModel:
    with _translated(source):
        # without simplification every model of a case keeps the same variables
        program = stormpy.parse_prism_program(path, prism_compatibility=True, simplify=False)
    if program.has_undefined_constants:
        raise InputError(f"{source}: a constant has no value")
    options = stormpy.BuilderOptions(build_full=True)
    options.set_build_choice_labels(True)
    options.set_build_state_valuations(True)
    options.set_add_out_of_bounds_state(True)
    with _translated(source, ModelError):
        model = stormpy.build_model(program, options=options)
    if model.model_type not in (ModelType.MDP, ModelType.DTMC):
        raise InputError(f"{source}: is neither an MDP nor a discrete-time Markov chain")
    storm = StormModel(source, program, model)
    _require_sound(storm)
    return storm


def _require_sound(storm: StormModel) -> None:
    labels = storm.model.labeling
    if OUT_OF_BOUNDS in labels.get_labels() and labels.get_states(OUT_OF_BOUNDS):
        raise ModelError(f"{storm.source}: {_stray_choice(storm.model)} leaves the range of a variable")
    arrays = storm.mdp(reward=None)  # refuses sums other than 1 and repeated actions
    stuck = np.flatnonzero(arrays.labels[DEADLOCK])
    if len(stuck):
        raise ModelError(f"{storm.source}: state {arrays.describe_state(int(stuck[0]))} has no action")


def _stray_choice(model: Any) -> str:
    """A choice that leads to the state for what is out of bounds, in words."""
    stray = next(iter(model.labeling.get_states(OUT_OF_BOUNDS)))
    sources = [entry.column for entry in model.backward_transition_matrix.get_row(stray)]
    source = next(state for state in sources if state != stray)
    action = next(
        action
        for action in model.states[source].actions
        if any(transition.column == stray for transition in action.transitions)
    )
    names = ", ".join(action.labels) or "(unnamed)"
    terms = model.state_valuations.to_string(source).strip("[]").replace("\t", "").split("& ")
    valuation = ", ".join(term for term in terms if "_OutOfBoundsBit" not in term)
    return f"({valuation}), action {names}"


@contextmanager
def _translated(place: str, user_error: type[MerapError] = InputError, model: Any = None) -> Iterator[None]:
    """Storm raises plain RuntimeErrors; `model` is given where they are about a property of it."""
    known = None
    if model is not None:
        known = {"label": sorted(model.labeling.get_labels()), "reward model": sorted(model.reward_models)}
    try:
        yield
    except (RuntimeError, StormError) as error:
        raise translate(str(error), place, user_error, known) from error
