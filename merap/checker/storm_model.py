"""Hold a model that Storm has built: check its properties, read its arrays, export it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import stormpy
from stormpy.developer.storage._storage import BitVector
from stormpy.models import ModelType

from merap.checker.evaluation import Evaluator
from merap.checker.exchange import Answer
from merap.checker.prism_parsing import read_formulas, read_tree
from merap.checker.property_file import Property, read_property
from merap.checker.solving import translated
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.errors import EngineError, ModelError
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.reserved_names import OBJECTIVE_REWARD
from merap.mdp.umb import read_umb
from merap.program.expressions import Constant, Expression, fold


@dataclass(frozen=True, eq=False)
class StormModel:
    """A sound model that Storm has built; it does not pickle.

    Attributes:
        source: name of its text in messages.
        program: stormpy's program; None if the model comes from an archive.
        model: stormpy's sparse model.
        numbered: number the choices of one name in a state, instead of refusing them.
    """

    source: str
    program: Any
    model: Any
    numbered: bool = False

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
        return self.check_property(read_property(text, self.source), initial)

    def check_property(self, given: Property, initial: Floats | None = None) -> Answer:
        """Check a parsed property; arguments and errors as of `check`."""
        weights = self.arrays.initial if initial is None else initial
        return Evaluator(self, f"{self.source}: property {given.text!r}").answer(given.tree, weights)

    @cached_property
    def exact(self) -> Any:
        """stormpy's sparse model in fractions, its states in the same order as those of `model`.

        Raises:
            UnsupportedPropertyError: the model comes from an archive, which holds doubles.
            ModelError: a guard or probability is another one in fractions, so the states differ.
        """
        if self.program is None:
            raise UnsupportedPropertyError(f"{self.source}: needs fractions, and the archive holds doubles")
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
        for name, mask in self._own_labels.items():
            _add_label(exact, name, mask)
        return exact

    @property
    def is_chain(self) -> bool:
        """Tell whether the model is a Markov chain."""
        return bool(self.model.model_type == ModelType.DTMC)

    @cached_property
    def structures(self) -> tuple[str, ...]:
        """Names of the reward structures, in the order of the text."""
        if self.program is None:
            return tuple(self.model.reward_models)
        return tuple(one.name for one in self.program.reward_models)

    def rewards(self, structure: str) -> Floats:
        """Return float64 [C], the expected reward of each choice."""
        found = self.model.reward_models[structure]
        rewards: Floats = np.zeros(self.model.nr_choices)
        if found.has_state_rewards:
            rewards += np.repeat(np.array(found.state_rewards), np.diff(self.arrays.state_to_choice))
        if found.has_state_action_rewards:
            rewards += np.array(found.state_action_rewards)
        return rewards

    @cached_property
    def constants(self) -> Mapping[str, Fraction | bool]:
        """Values of the constants of the text."""
        if self.program is None:
            return {}
        found: dict[str, Fraction | bool] = {}
        for one in self.program.constants:  # each may use those before it
            value = fold(read_tree(one.definition), found)
            if isinstance(value, Constant):
                found[one.name] = value.value
        return found

    @cached_property
    def definitions(self) -> Mapping[str, Expression]:
        """Formulas and constants of the text, over variables."""
        constants = {name: Constant(value) for name, value in self.constants.items()}
        return constants if self.program is None else constants | dict(read_formulas(self.program))

    @cached_property
    def columns(self) -> Mapping[str, npt.NDArray[Any]]:
        """Values of the variables in all states, [S]; bool where a variable is."""
        bools: set[str] = set()
        if self.model.has_state_valuations:
            variables = self.model.state_valuations.get_all_variables()
            bools = {one.name for one in variables if one.has_boolean_type()}
        arrays = self.arrays
        return {
            name: arrays.valuations[:, place].astype(bool) if name in bools else arrays.valuations[:, place]
            for place, name in enumerate(arrays.variable_names)
        }

    @cached_property
    def labels(self) -> Mapping[str, Bools]:
        """Label -> bool [S], where it holds; `init` is one."""
        return {"init": self.arrays.initial > 0, **self.arrays.labels}

    @cached_property
    def _own_labels(self) -> dict[str, Bools]:
        return {}

    def mask_of(self, label: str) -> Bools:
        """Return bool [S], where a label holds, one of the text or of ours."""
        return self._own_labels[label] if label in self._own_labels else self.labels[label]

    def label_of(self, mask: Bools) -> str:
        """Return the name of a label that holds where bool [S] is true."""
        for name, known in self._own_labels.items():
            if np.array_equal(known, mask):
                return name
        name = f"merap_{len(self._own_labels)}"
        while self.model.labeling.contains_label(name):
            name += "_"
        self._own_labels[name] = mask
        _add_label(self.model, name, mask)
        if "exact" in self.__dict__:
            _add_label(self.exact, name, mask)
        return name

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
                return read_umb(path, reward=reward, numbered=self.numbered)
            except ModelError as error:
                raise ModelError(f"{self.source}: {error.__cause__ or error}") from error


def _size(model: Any) -> tuple[int, int, int]:
    return model.nr_states, model.nr_choices, model.nr_transitions


def _add_label(model: Any, name: str, mask: Bools) -> None:
    model.labeling.add_label(name)
    model.labeling.set_states(name, BitVector(len(mask), np.flatnonzero(mask).tolist()))
