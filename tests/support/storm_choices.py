"""Storm's own build of a text, as plain Python, to compare with other routes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import stormpy

from merap.program.form import Program
from tests.support.explored import Choices


def build(path: Path, constants: Mapping[str, str]) -> Any:
    """Return stormpy's sparse model with valuations, labels of choices and all labels."""
    options = stormpy.BuilderOptions()
    options.set_build_state_valuations(True)
    options.set_build_choice_labels(True)
    options.set_build_all_labels(True)
    program = stormpy.parse_prism_program(str(path), prism_compatibility=True, simplify=False)
    if constants:
        definitions = ",".join(f"{name}={value}" for name, value in constants.items())
        program, _ = stormpy.instantiate_constants(program, definitions, [])
    return stormpy.build_model(program, options=options)


def choices_of_storm(program: Program, model: Any) -> Choices:
    """As `choices_of`; the self-loops that Storm adds to states without a choice are left out."""
    values = model.state_valuations
    known = {str(one.name): one for one in values.get_all_variables()}
    read = [known[one.name] for one in program.variables]
    states = [tuple(values.get_value(state, one) for one in read) for state in range(model.nr_states)]
    dead = model.labeling.get_states("deadlock") if "deadlock" in model.labeling.get_labels() else []
    result: Choices = {state: Counter() for state in states}
    start = model.transition_matrix.get_row_group_start
    for number, state in enumerate(states):
        if number in list(dead):
            continue
        for row in range(start(number), start(number + 1)):
            labels = model.choice_labeling.get_labels_of_choice(row)
            pairs = frozenset(
                (states[entry.column], round(entry.value, 12))
                for entry in model.transition_matrix.get_row(row)
            )
            result[state][next(iter(labels), None), pairs] += 1
    return result
