"""Define what is read of a PRISM text; it pickles and needs no engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from merap.program.expressions import Expression
from merap.program.form import Program

ConstantType: TypeAlias = Literal["int", "bool", "double"]


@dataclass(frozen=True, eq=False)
class PrismModel:
    """A PRISM text.

    Attributes:
        program: its modules; constants that the text leaves open, and PAYNT's holes, are parameters.
        constants: those constants, read or not, and their types.
        definitions: the text's other constants and its formulas, over variables and open constants.
    """

    program: Program
    constants: Mapping[str, ConstantType]
    definitions: Mapping[str, Expression]
