"""Storm as the second route: what it says of a UMB archive."""

from __future__ import annotations

from pathlib import Path

import stormpy


def storm_values(path: Path, formula: str) -> list[float]:
    """Return the value of each state, iterated to a precision of 1e-12."""
    model = stormpy.build_model_from_umb(str(path))
    env = stormpy.environments.default(model)
    env.solver().min_max().precision = stormpy.Rational("1/1000000000000")
    result = stormpy.model_checking(model, stormpy.parse_properties(formula)[0], environment=env)
    return [result.get_value(state) for state in range(model.nr_states)]
