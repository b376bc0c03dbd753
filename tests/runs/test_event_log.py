"""Events of a training run for TensorBoard."""

from __future__ import annotations

import warnings
from pathlib import Path

from tests.support.trained_runs import SMALL, trained


def test_events_for_tensorboard_are_written_on_request(tmp_path: Path) -> None:
    run = trained(tmp_path / "run", SMALL.model_copy(update={"tensorboard": True}))
    (file,) = (run.path / "events").iterdir()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the reader's own
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # noqa: PLC0415

        events = EventAccumulator(str(file.parent))
        events.Reload()
    assert "adapted_return" in events.Tags()["scalars"]
    assert [event.step for event in events.Scalars("adapted_return")] == [1, 2, 3, 4, 5]
