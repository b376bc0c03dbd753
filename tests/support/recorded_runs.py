"""A small run in a knowledge base, with an entry of every kind."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from safetensors.numpy import save

from merap.knowledge.base import KnowledgeBase
from merap.knowledge.rows import DecisionRow, EventRow, ObservationRow

SETTINGS = {"strategy": "belief", "seed": 3}
TABLE = np.array([[0.25, 0.75], [1.0, 0.0]])
UMB = b"a model"
RESET = ObservationRow(0, 0, (8, 0), None, 0.0, 1.0, False, {"lidar": {"1,2": True}}, (True, False))
STEP = ObservationRow(0, 1, (7, 0), 1, -0.5, 1.0, False)
UNSEEN = ObservationRow(0, 2, None, 0, 0.0, 1.0, False)
GOAL = ObservationRow(1, 1, (0, 8), 0, 10.0, 0.0, False)
LATE = ObservationRow(1, 2, (0, 7), 1, 0.1 + 0.2, 1.0, True)
REPLAN = DecisionRow(0, 1, "replan", ("reward fell below 0.5", "a goal was moved"), {"statistic": 0.1})
SETTLED = DecisionRow(1, 1, "settled")
EVENT = EventRow(datetime(2026, 11, 24, 18, 0, 0, 123456, UTC), "monitor", "warning", "late", {"ms": 12})


def record_run(knowledge: KnowledgeBase) -> int:
    """Record it as a loop does: an episode's observations, then its decisions."""
    run = knowledge.start_run("shifts.merap", "running_example", "d" * 64, SETTINGS)
    model = knowledge.record_model(run, "b_blocked.speed_low.g1", UMB)
    knowledge.record_policy(run, "meta", 0, save({"policy": TABLE}), model)
    knowledge.record_observations(run, [RESET, STEP, UNSEEN])
    knowledge.record_decision(run, REPLAN)
    knowledge.record_observations(run, [GOAL, LATE])
    knowledge.record_decision(run, SETTLED)
    knowledge.record_policy(run, "adapted", 1, save({"policy": TABLE}))
    knowledge.record_event(run, EVENT)
    knowledge.record_checkpoint(run, 2, b"\x00state")
    knowledge.finish_run(run, {"utility": 3.5})
    return run
