"""Build models with Storm, through stormpy, from PRISM text and from archives.

Storm accepts broken models by default: sums below 1, values past their range, deadlocks. Here
they are refused, with the state they occur in; in models of other people deadlocks are repaired aloud.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import stormpy
from stormpy.developer import LogLevel, set_log_level
from stormpy.developer.info import StormVersion
from stormpy.models import ModelType

from merap.checker.exchange import ForeignModel, ModelText
from merap.checker.solving import translated
from merap.checker.storm_model import StormModel
from merap.errors import InputError, ModelError
from merap.mdp.matching import match_rows
from merap.mdp.model import Floats

OUT_OF_BOUNDS = "out_of_bounds"
DEADLOCK = "deadlock"

set_log_level(LogLevel.OFF)  # it writes to standard output what it raises anyway


def version() -> str:
    """Return Storm's own version, as `2.0.0`."""
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


def build_weighted(model: ModelText) -> tuple[StormModel, Floats]:
    """Build a model whose initial states have weights; raises as `build_text`.

    Returns:
        The model, and float64 [S], the distribution over its states in which it begins.
    """
    storm = build_text(model.text, model.name)
    arrays = storm.arrays
    columns = [arrays.variable_names.index(name) for name in model.variables]
    initial_states = np.flatnonzero(arrays.initial)
    row = match_rows(model.starts, arrays.valuations[initial_states][:, columns])
    initial = np.zeros(arrays.num_states)
    initial[initial_states[row]] = model.weights
    return storm, initial


def build_file(path: Path) -> StormModel:
    """Parse and build a file of PRISM text; raises as `build_text`."""
    if not path.is_file():
        raise InputError("there is no such file", source=str(path))
    return _build(path, str(path))


class Foreign(NamedTuple):
    """A model of other people, and what is to be said about it."""

    storm: StormModel
    notes: tuple[str, ...]


def build_foreign(model: ForeignModel) -> Foreign:
    """Build a model that others wrote: commands need no action, deadlocks get a loop, as PRISM gives them.

    Raises:
        InputError: a syntax error, another kind of model, or a constant without value.
        ModelError: a value out of its range, or probabilities that do not sum to 1; names state and action.
        EngineError: Storm can't build it.
    """
    if model.text is None:
        with translated(model.name, InputError):
            built = stormpy.build_model_from_umb(model.path)
        _require_kind(built, model.name)
        storm = StormModel(model.name, None, built, numbered=True)
    else:
        with tempfile.TemporaryDirectory(prefix="merap-") as folder:
            path = Path(folder) / "model.prism"
            path.write_text(model.text, encoding="utf-8")
            storm = _built(path, model.name, model.constants, numbered=True)
        _require_bounds(storm)
    arrays = storm.arrays  # refuses sums other than 1
    notes = []
    stuck = np.flatnonzero(arrays.labels.get(DEADLOCK, np.zeros(0, dtype=np.bool_)))
    if len(stuck):
        state = arrays.describe_state(int(stuck[0]))
        count = "1 state has" if len(stuck) == 1 else f"{len(stuck)} states have"
        notes.append(f"{count} no action, as {state}: a loop is added, as PRISM does")
    starts = int(np.count_nonzero(arrays.initial))
    if starts > 1:
        notes.append(f"{starts} initial states: values are means over them, truths hold in all")
    return Foreign(storm, tuple(notes))


def _build(path: Path, source: str) -> StormModel:
    storm = _built(path, source)
    _require_bounds(storm)
    arrays = storm.arrays  # refuses sums other than 1 and repeated actions
    stuck = np.flatnonzero(arrays.labels[DEADLOCK])
    if len(stuck):
        raise ModelError(f"{storm.source}: state {arrays.describe_state(int(stuck[0]))} has no action")
    return storm


def _built(path: Path, source: str, constants: str = "", *, numbered: bool = False) -> StormModel:
    with translated(source):
        # without simplification every model of a case keeps the same variables
        program = stormpy.parse_prism_program(path, prism_compatibility=True, simplify=False)
        if constants:
            program, _ = stormpy.instantiate_constants(program, constants, [])
    if program.has_undefined_constants:
        raise InputError(f"{source}: a constant has no value")
    options = stormpy.BuilderOptions(build_full=True)
    options.set_build_choice_labels(True)
    options.set_build_state_valuations(True)
    options.set_add_out_of_bounds_state(True)
    with translated(source, ModelError):
        model = stormpy.build_model(program, options=options)
    _require_kind(model, source)
    return StormModel(source, program, model, numbered)


def _require_kind(model: Any, source: str) -> None:
    if model.model_type not in (ModelType.MDP, ModelType.DTMC):
        raise InputError(f"{source}: is neither an MDP nor a discrete-time Markov chain")


def _require_bounds(storm: StormModel) -> None:
    labels = storm.model.labeling
    if OUT_OF_BOUNDS in labels.get_labels() and labels.get_states(OUT_OF_BOUNDS):
        raise ModelError(f"{storm.source}: {_stray_choice(storm.model)} leaves the range of a variable")


def _stray_choice(model: Any) -> str:
    """Describe a choice that leads to the state for values out of bounds."""
    stray = next(iter(model.labeling.get_states(OUT_OF_BOUNDS)))
    sources = [entry.column for entry in model.backward_transition_matrix.get_row(stray)]
    source = next(state for state in sources if state != stray)
    action = next(
        action
        for action in model.states[source].actions
        if any(transition.column == stray for transition in action.transitions)
    )
    names = ", ".join(action.labels) or "(unnamed)"
    values = model.state_valuations
    named = ((one.name, values.get_value(source, one)) for one in values.get_all_variables())
    # as in other messages about states: true is 1
    terms = (f"{name}={int(value)}" for name, value in named if name != "_OutOfBoundsBit")
    return f"({', '.join(terms)}), action {names}"
