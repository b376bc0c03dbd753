"""What a policy sees of a state by its variables: the factored observation.

Every variable is encoded by its kind, in a way that doesn't depend on the size of the model: the
same parameters then run on a larger grid. A coordinate gives where it lies between its bounds and
sine and cosine of its distance from the lower bound at several wavelengths (the positional
encoding of Vaswani et al. 2017, section 3.5), so that near values look alike and all of them
apart.

Axes: S states, V variables, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, MODE_VARIABLE
from merap.program.form import Kind, StateVariable

Scale = Literal["flag", "coordinate", "category"]

# Neighbours are a quarter of a turn apart at the shortest; the longest tells 256 values apart.
_WAVELENGTHS = np.array([4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0])
# Numbers whose order means nothing, as cases and imported models call them.
_CATEGORIES = frozenset({"loc", MODE_VARIABLE, "state", "passenger", "destination"})
_COORDINATES = frozenset({"row", "col", "taxi_row", "taxi_col"})


@dataclass(frozen=True)
class VariableKind:
    """What the values of a state variable mean.

    Attributes:
        name: of the variable.
        scale: `flag`, 0 or 1; `coordinate`, integers in order; `category`, numbers of things.
        low: least value.
        high: greatest value.
    """

    name: str
    scale: Scale
    low: int
    high: int

    @property
    def num_features(self) -> int:
        """How many features it is encoded by; a variable that has one value needs none."""
        if self.scale == "flag":
            return 1
        if self.scale == "coordinate":
            return 1 + 2 * len(_WAVELENGTHS)
        return self.high - self.low + 1 if self.high > self.low else 0


def variable_kind(variable: StateVariable) -> VariableKind:
    """Return the kind of a program's variable: a flag, a coordinate, or named things."""
    scales: dict[Kind, Scale] = {"bool": "flag", "int": "coordinate", "named": "category"}
    return VariableKind(variable.name, scales[variable.kind], variable.low, variable.high)


def model_kinds(model: TabularMDP) -> tuple[VariableKind, ...]:
    """Return the kinds of a model's variables, as far as names and values tell.

    `loc`, `mode`, `state` and the variables of the taxi's passenger are categories; another one
    without other values than 0 and 1 is a flag, unless it is called a row or column; the rest are
    coordinates.
    """
    values = model.valuations[~model.labels.get(COMPLETE_LABEL, np.zeros(model.num_states, dtype=np.bool_))]
    lows, highs = values.min(axis=0).tolist(), values.max(axis=0).tolist()
    return tuple(
        VariableKind(name, _scale(name, low, high), low, high)
        for name, low, high in zip(model.variable_names, lows, highs, strict=True)
    )


def _scale(name: str, low: int, high: int) -> Scale:
    if name in _CATEGORIES:
        return "category"
    is_flag = low >= 0 and high <= 1 and name not in _COORDINATES
    return "flag" if is_flag else "coordinate"


def observation_features(
    kinds: Sequence[VariableKind], valuations: Ints, completed: Bools
) -> npt.NDArray[np.float32]:
    """Return the factored observation of every state.

    Args:
        kinds: V kinds.
        valuations: int64 [S, V].
        completed: bool [S], states whose valuations mean nothing.

    Returns:
        float32 [S, F], the features of one variable after those of another; 0 throughout for
        completed states.

    Raises:
        ModelError: a value is out of its variable's range; names it.
    """
    assert valuations.shape == (len(valuations), len(kinds)), (valuations.shape, len(kinds))
    columns = []
    for kind, values in zip(kinds, valuations.T, strict=True):
        strange = np.flatnonzero(~completed & ((values < kind.low) | (values > kind.high)))
        if len(strange):
            raise ModelError(f"{kind.name} is {values[strange[0]]}, allowed is {kind.low}..{kind.high}")
        columns.append(_encoded(kind, values))
    features = np.hstack(columns) * ~completed[:, np.newaxis]
    return features.astype(np.float32)


def _encoded(kind: VariableKind, values: Ints) -> Floats:
    """float64 [S, features of the kind]."""
    if kind.scale == "flag":
        return values[:, np.newaxis].astype(np.float64)
    if kind.scale == "category":
        categories = np.arange(kind.low, kind.low + kind.num_features)
        member: Bools = values[:, np.newaxis] == categories
        return member.astype(np.float64)
    distance = (values - kind.low)[:, np.newaxis]
    angle = 2 * np.pi * distance / _WAVELENGTHS
    return np.hstack([distance / max(kind.high - kind.low, 1), np.sin(angle), np.cos(angle)])
