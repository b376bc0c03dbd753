"""What streams come to, on figures made by hand."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from scripts.bench.trigger_delay import Change, World, watch
from scripts.bench.trigger_score import beside_bound, of_kind, score_change, without_change
from scripts.bench.trigger_streams import effect, known
from tests.support.hand_made import cells, grid_combination

WORLD = World()


def figures(soon: int, loose: float, strict: float, **other: Any) -> dict[str, Any]:
    """A costly change with 20 streams; what is possible with more and with fewer false alarms."""
    return {
        "kind": "costly",
        "loss": 0.5,
        "streams": 20,
        "steps": 10_000,
        "alarms before the change": 0,
        "alarms": 20,
        "soon": soon,
        "median delay": 2.0,
        "most": 7.0,
        "least mean delay": 1.0,
        "most within 3 at 1 false alarms": loose,
        "most within 3 at 0.1 false alarms": strict,
        **other,
    }


def test_what_is_seen_is_counted_among_what_is_possible() -> None:
    """19 of 20 are 95 percent; the last but one is possible only with more false alarms, the last never."""
    rows = [
        figures(19, 1.0, 0.95),
        figures(18, 1.0, 0.99),
        figures(19, 0.97, 0.90, loss=0.25),
        figures(5, 0.94, 0.80, **{"median delay": None}),
        figures(0, 0.1, 0.1, kind="small"),
    ]
    found = beside_bound(rows)
    assert [found[name] for name in ("changes", "costly", "95 percent")] == [5, 4, 2]
    assert [found[name] for name in ("possible", "of these seen", "impossible")] == [2, 1, 1]
    assert found["within 3"] == pytest.approx((19 + 18 + 19 + 5) / 80)
    assert found["at most"] == pytest.approx((0.95 + 0.99 + 0.90 + 0.80) / 4)
    assert [found["least loss"], found["most loss"]] == [0.25, 0.5]
    assert found["median delay"] == 2.0


def test_alarms_are_told_as_a_rate_too() -> None:
    found = of_kind([figures(3, 1.0, 1.0, alarms=3), figures(0, 1.0, 1.0, alarms=0, most=None)])
    assert found["alarms in 100,000 steps"] == pytest.approx(3 * 100_000 / 20_000)
    assert [found[name] for name in ("changes", "streams", "alarms", "soon", "most")] == [2, 40, 3, 3, 7.0]


def test_nothing_to_count() -> None:
    assert of_kind([])["part within 3"] is None
    assert beside_bound([])["median delay"] is None


def test_streams_without_a_change() -> None:
    found = without_change([0, 2, 1])
    assert [found[name] for name in ("false alarms", "most in a stream", "streams with at most one")] == [
        3,
        2,
        2,
    ]


@pytest.mark.parametrize(("slip", "nats"), [(0.0, None), (0.1, 0.0)], ids=["held impossible", "not visited"])
def test_the_figures_of_a_change_are_json(slip: float, nats: float | None) -> None:
    """Known without slip, the robot slips: infinitely many nats, which JSON has no word for."""
    world = World(slip=slip)
    before = known(grid_combination(goal=(2, 2)), slip)
    real = WORLD.model(grid_combination(blocked=cells((8, 8)), goal=(2, 2)))
    change = Change("worn", before, before.model, real, effect(before, real))
    generator = np.random.default_rng(0)
    found = score_change("grid", watch(change, world, 3, 5, generator), world, generator)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["nats per episode"] == nats
    # 12 steps that may slip tell it with 1 - 0.9^12 = 0.72; unvisited, nothing does
    assert (found["most within 3 at 0.1 false alarms"] > 0.6) == (slip == 0)
