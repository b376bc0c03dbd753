"""Conditions on states as arrays over locations and modes."""

from __future__ import annotations

import numpy as np

from merap.belief.steps import holds_in_states
from merap.program.expressions import all_of
from tests.support.hand_made import at, graph_combination, parsed

IDLE, SCANNING = 0, 1
S, A = 0, 1


def test_conditions_on_states_read_location_mode_and_attributes() -> None:
    graph = graph_combination()
    condition = all_of([at(np.array([True, True, True, False])), parsed("mode < 2 & light + mode > 2")])
    # light is 3, 2, 0 at S, A, B: S always, A when scanning
    assert np.flatnonzero(holds_in_states(graph, condition)).tolist() == [
        3 * S + IDLE,
        3 * S + SCANNING,
        3 * A + SCANNING,
    ]
