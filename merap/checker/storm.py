"""Build, check and export models with Storm, through stormpy.

Storm accepts broken models by default: sums below 1, values past their range, deadlocks. Here
they are refused, with the state they occur in.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import stormpy
from stormpy.developer import LogLevel, set_log_level
from stormpy.developer.info import StormVersion
from stormpy.models import ModelType

from merap.checker.exchange import Answer, ModelText
from merap.checker.solving import answer, translated
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.errors import EngineError, InputError, ModelError
from merap.mdp.matching import match_rows
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.reserved_names import OBJECTIVE_REWARD
from merap.mdp.umb import read_umb

OUT_OF_BOUNDS = "out_of_bounds"
DEADLOCK = "deadlock"
_NO_FILTER = re.compile(r"""\([^)]*\): Obtain the values of the '"init"'-states with """)

set_log_level(LogLevel.OFF)  # it writes to standard output what it raises anyway


@dataclass(frozen=True, eq=False)
class StormModel:
    """A sound model that Storm has built; it does not pickle.

    Attributes:
        source: name of its text in messages.
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
            ModelError: the model is another one in exact arithmetic, which the property needs.
            EngineError: Storm failed.
        """
        place = f"{self.source}: property {text!r}"
        formula = _parse_property(text, self.program, self.model, place)
        states = list(self.model.initial_states)
        weights = np.full(len(states), 1 / len(states)) if initial is None else initial[states]
        return answer(self, formula, place, weights)

    @cached_property
    def exact(self) -> Any:
        """stormpy's sparse model in fractions, its states in the same order as those of `model`.

        Raises:
            ModelError: a guard or probability is another one in fractions, so the states differ.
        """
        options = stormpy.BuilderOptions()
        options.set_build_all_reward_models()
        options.set_build_all_labels()
        with translated(self.source, EngineError):
            exact = stormpy.build_model[stormpy.Rational](self.program, options=options)
        if _size(exact) != _size(self.model):
            raise ModelError(
                f"{self.source}: {_size(exact)} states, choices and branches in exact arithmetic, but "
                f"{_size(self.model)} in doubles; a guard or a probability depends on rounding"
            )
        return exact

    def rewards(self, structure: str | None) -> Floats | None:
        """Return float64 [C], the expected reward of each choice; None if there is no such structure.

        Args:
            structure: its name; None for the only one.
        """
        structures = self.model.reward_models
        if structure is None:
            structure = next(iter(structures), None)
        if structure not in structures:
            return None
        found = structures[structure]
        rewards: Floats = np.zeros(self.model.nr_choices)
        if found.has_state_rewards:
            rewards += np.repeat(np.array(found.state_rewards), np.diff(self.arrays.state_to_choice))
        if found.has_state_action_rewards:
            rewards += np.array(found.state_action_rewards)
        return rewards

    @cached_property
    def arrays(self) -> TabularMDP:
        """The model as arrays, with the rewards of its `objective` if it has some."""
        return self._read(self._own_reward)

    def export_umb(self, path: Path) -> None:
        """Write the model as an uncompressed UMB archive.

        Raises:
            EngineError: Storm can't write it.
        """
        options = stormpy.io.UmbExportOptions()
        options.compression = stormpy.io.CompressionMode.NO_COMPRESSION
        with translated(self.source, EngineError):
            stormpy.io.umb_to_archive(
                stormpy.io.sparse_model_to_umb(self.model, options=options), path, options
            )

    def mdp(self, reward: str | None = OBJECTIVE_REWARD) -> TabularMDP:
        """Return the model as arrays, through a UMB archive that is mapped into memory.

        Args:
            reward: the reward structure to take; None for rewards of 0.

        Raises:
            ModelError: the model breaks an invariant of `TabularMDP`.
        """
        return self.arrays if reward == self._own_reward else self._read(reward)

    @property
    def _own_reward(self) -> str | None:
        return OBJECTIVE_REWARD if OBJECTIVE_REWARD in self.model.reward_models else None

    def _read(self, reward: str | None) -> TabularMDP:
        with tempfile.TemporaryDirectory(prefix="merap-") as folder:
            path = Path(folder) / "model.umb"
            self.export_umb(path)
            try:
                return read_umb(path, reward=reward)
            except ModelError as error:
                raise ModelError(f"{self.source}: {error.__cause__ or error}") from error


def _parse_property(text: str, program: Any, model: Any, place: str) -> Any:
    with translated(place, model=model):
        parsed = stormpy.parse_properties(text, program)
    if len(parsed) != 1:
        raise InputError(f"{place}: holds {len(parsed)} properties, expected 1")
    if not _NO_FILTER.match(str(parsed[0])):
        raise UnsupportedPropertyError(
            f"{place}: filters are not supported, values are of the initial states"
        )
    if parsed[0].contains_undefined_constants():
        raise InputError(f"{place}: a constant has no value")
    return parsed[0].get_raw_formula()


def _size(model: Any) -> tuple[int, int, int]:
    return model.nr_states, model.nr_choices, model.nr_transitions


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


def _build(path: Path, source: str) -> StormModel:
    with translated(source):
        # without simplification every model of a case keeps the same variables
        program = stormpy.parse_prism_program(path, prism_compatibility=True, simplify=False)
    if program.has_undefined_constants:
        raise InputError(f"{source}: a constant has no value")
    options = stormpy.BuilderOptions(build_full=True)
    options.set_build_choice_labels(True)
    options.set_build_state_valuations(True)
    options.set_add_out_of_bounds_state(True)
    with translated(source, ModelError):
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
    arrays = storm.arrays  # refuses sums other than 1 and repeated actions
    stuck = np.flatnonzero(arrays.labels[DEADLOCK])
    if len(stuck):
        raise ModelError(f"{storm.source}: state {arrays.describe_state(int(stuck[0]))} has no action")


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
