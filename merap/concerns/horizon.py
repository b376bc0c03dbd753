"""The horizon of an objective: a number, or what a parameter says."""

from __future__ import annotations

from merap.concerns.document import Document
from merap.concerns.parameters import ParameterTypes, Values
from merap.concerns.schema_objective import MAX_HORIZON
from merap.program.names import suggestion


def check_horizon(document: Document, horizon: int | str, types: ParameterTypes) -> None:
    """Refuse a horizon that is no number and no parameter that can be one.

    Args:
        document: where it stands.
        horizon: as given.
        types: the parameters of the objective.

    Raises:
        InputError: says so.
    """
    if isinstance(horizon, str) and (horizon not in types or types[horizon].name != "int"):
        whole = [name for name, of in types.items() if of.name == "int"]
        raise document.error(
            ("objective", "horizon"),
            f"expected a number, or a parameter of type int; got {horizon!r}{suggestion(horizon, whole)}",
        )


def horizon_of(document: Document, horizon: int | str, name: str, values: Values) -> int:
    """Return the horizon of the objective called `name`, whose parameters have some values.

    Raises:
        InputError: it is too short or too long.
    """
    if isinstance(horizon, int):
        return horizon
    steps = int(values[horizon])  # type: ignore[arg-type]
    if not 1 <= steps <= MAX_HORIZON:
        raise document.error(
            ("objective", "configurations", name, horizon),
            f"the horizon is {steps}, allowed is 1 to {MAX_HORIZON}",
        )
    return steps
