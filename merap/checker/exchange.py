"""Define a model as a checker gets it, and the answers it gives; both pickle and need no engine."""

from __future__ import annotations

from dataclasses import dataclass

from merap.mdp.model import Floats, Ints


@dataclass(frozen=True, eq=False)
class ModelText:
    """A model as text, beside what the text can't say.

    PRISM's language has initial states without weights, an objective has weights.

    Attributes:
        name: name of the model.
        text: in PRISM's language.
        variables: names of the V variables that tell initial states apart.
        starts: int64 [I, V], their values in the initial states.
        weights: float64 [I], the probabilities of these.
    """

    name: str
    text: str
    variables: tuple[str, ...]
    starts: Ints
    weights: Floats


@dataclass(frozen=True)
class ForeignModel:
    """A model that somebody else wrote, one for each choice of its open constants.

    Attributes:
        name: name of the model.
        text: in PRISM's language; None for an archive.
        path: of the UMB archive.
        constants: values for its open constants, as `N=3,p=0.5`.
    """

    name: str
    text: str | None = None
    path: str | None = None
    constants: str = ""


@dataclass(frozen=True)
class Answer:
    """A model checker's answer to one property in the initial states.

    Attributes:
        value: the expected value over the initial distribution, of a property with a bound
            that of the same property without; None for a truth value alone.
        lower: sound lower bound of `value`; None if the engine gives none.
        upper: sound upper bound of `value`; None if the engine gives none.
        holds: whether it is true in every initial state; None if it asks for a value.
        exact: whether the value was computed in fractions.
        least: the least value of an initial state; None without a value.
        greatest: the greatest value of an initial state.
    """

    value: float | None = None
    lower: float | None = None
    upper: float | None = None
    holds: bool | None = None
    exact: bool = False
    least: float | None = None
    greatest: float | None = None
