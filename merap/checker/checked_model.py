"""Define what a model tells those who solve properties.

Axes: S states, C choices.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Protocol

import numpy.typing as npt

from merap.checker.solving import Models
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.program.expressions import Expression


class CheckedModel(Models, Protocol):
    """A model whose operators are solved: its variables can be read, and labels added to it."""

    @property
    def arrays(self) -> TabularMDP:
        """The same as arrays."""

    @property
    def is_chain(self) -> bool:
        """Tell whether no state has a choice to make."""

    @property
    def structures(self) -> tuple[str, ...]:
        """Names of the reward structures, in the order of the text."""

    @property
    def labels(self) -> Mapping[str, Bools]:
        """Label -> bool [S], where it holds; those of the text and `init`."""

    def rewards(self, structure: str) -> Floats:
        """Return float64 [C], the expected reward of each choice."""

    def label_of(self, mask: Bools) -> str:
        """Return the name of a label that holds where bool [S] is true."""

    def mask_of(self, label: str) -> Bools:
        """Return bool [S], where a label holds."""

    @property
    def definitions(self) -> Mapping[str, Expression]:
        """Formulas and constants of the text, over variables."""

    @property
    def columns(self) -> Mapping[str, npt.NDArray[Any]]:
        """Values of the variables in all states, [S]; bool where a variable is."""

    @property
    def constants(self) -> Mapping[str, Fraction | bool]:
        """Values of the constants of the text."""
