"""Storm through stormpy: parse, build, check, export. The only importer of stormpy.

Storm accepts broken models by default: sums below 1, values past their range, deadlocks. Here
they are refused, with the state they occur in.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import stormpy
from stormpy.developer import LogLevel, set_log_level
from stormpy.developer.info import StormVersion

from merap.errors import EngineError, InputError, MerapError, ModelError
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.umb import read_umb

PRECISION = "1/1000000000000"
# Storm names its exceptions in its messages; these speak of what the user wrote.
_USER_ERRORS = ("WrongFormat", "InvalidProperty", "InvalidArgument", "InvalidType", "IllegalFunctionCall")

set_log_level(LogLevel.OFF)  # it writes to standard output what it raises anyway


@dataclass(frozen=True)
class Answer:
    """What a model checker says of one property in the initial states.

    Attributes:
        value: the expected value over the initial distribution; None for a truth value.
        lower: sound lower bound of `value`.
        upper: sound upper bound of `value`.
        holds: for a property with a bound, whether it is true in every initial state.
    """

    value: float | None
    lower: float | None
    upper: float | None
    holds: bool | None


@dataclass(frozen=True, eq=False)
class StormModel:
    """A model that Storm has built; it does not pickle.

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
            EngineError: Storm can't answer it.
        """
        with _translated(f"{self.source}: property {text!r}"):
            formulas = stormpy.parse_properties(text, self.program)
            if len(formulas) != 1:
                raise InputError(f"{text!r} holds {len(formulas)} properties, expected 1")
            result = stormpy.model_checking(self.model, formulas[0], environment=self._environment())
        if result is None:
            raise EngineError(f"{self.source}: Storm has no answer to {text!r}")
        return self._answer(result, initial)

    def _environment(self) -> Any:
        environment = stormpy.environments.default(self.model)
        environment.solver().min_max().precision = stormpy.Rational(PRECISION)
        return environment

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

    def mdp(self, reward: str = "objective") -> TabularMDP:
        """The model as arrays, through a UMB archive that is mapped into memory.

        Args:
            reward: the reward structure to take.

        Raises:
            ModelError: the model breaks an invariant of `TabularMDP`.
        """
        with tempfile.TemporaryDirectory(prefix="merap-") as folder:
            path = Path(folder) / "model.umb"
            self.export_umb(path)
            return read_umb(path, reward=reward)


def _mean(weights: list[float], values: list[float]) -> float:
    return sum(weight * float(value) for weight, value in zip(weights, values, strict=True))


def version() -> str:
    """Storm's own version, as `2.0.0`."""
    return str(StormVersion.short_version_string())


def build_text(text: str, source: str) -> StormModel:
    """Parse and build PRISM text.

    Args:
        text: the model.
        source: its name in messages.

    Raises:
        InputError: a syntax error.
        ModelError: a deadlock, or a value out of its range.
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
    options = stormpy.BuilderOptions(build_full=True)
    options.set_build_choice_labels(True)
    options.set_build_state_valuations(True)
    options.set_add_out_of_bounds_state(True)
    with _translated(source, EngineError):
        model = stormpy.build_model(program, options=options)
    _require_sound(model, source)
    return StormModel(source, program, model)


def _require_sound(model: Any, source: str) -> None:
    present = set(model.labeling.get_labels())
    for label, meaning in (
        ("out_of_bounds", "leaves the range of a variable"),
        ("deadlock", "has no action"),
    ):
        states = list(model.labeling.get_states(label)) if label in present else []
        if states:
            valuation = model.state_valuations.to_string(states[0])
            raise ModelError(f"{source}: a state {meaning}: {valuation} (and {len(states) - 1} more)")


@contextmanager
def _translated(source: str, kind: type[MerapError] | None = None) -> Iterator[None]:
    """Storm raises plain RuntimeErrors; say whose fault it is, in one line."""
    try:
        yield
    except RuntimeError as error:
        name, _, message = str(error).partition(": ")
        user = kind is None and name.startswith(_USER_ERRORS)
        chosen: type[MerapError] = InputError if user else (kind or EngineError)
        raise chosen(f"{source}: {' '.join((message or name).split())}") from error
