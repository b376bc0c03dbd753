"""What the trigger's streams come to, beside what any detector can do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from scripts.bench.trigger_bound import Ratio, most_in_time, nats_per_episode, ratio
from scripts.bench.trigger_curve import SOON, STEPS
from scripts.bench.trigger_delay import Watched, World, change_delays

# So many of the streams must be seen within `SOON` episodes.
MOST = 0.95
# False alarms in `STEPS` steps on average. The first is the most that a detector can have that never has more
# than one; the second is what `steps_per_false_alarm` guarantees by default.
LEVELS = (1.0, 0.1)


def score_change(case: str, watched: Watched, world: World, generator: np.random.Generator) -> dict[str, Any]:
    """Return the figures of one change.

    Args:
        case: its name.
        watched: the change and its streams.
        world: what is stated.
        generator: of the draws for the bound.
    """
    settings, change = world.settings, watched.change
    delays = change_delays(watched, settings)
    seen = delays[np.isfinite(delays)]
    return {
        "case": case,
        "change": change.name,
        "kind": change.kind,
        "loss": change.effect.loss,
        "streams": len(delays),
        "steps": sum(len(readings) - begin for readings, begin in watched.streams),
        "alarms before the change": int(np.isnan(delays).sum()),
        "alarms": len(seen),
        "soon": int((delays <= SOON).sum()),
        "median delay": _finite(float(np.nanmedian(delays))),
        "most": float(seen.max()) if len(seen) else None,
        **_bounds(watched, ratio(change.before.model, change.real, world.noise), world, generator),
    }


def _bounds(
    watched: Watched, found: Ratio, world: World, generator: np.random.Generator
) -> dict[str, float | None]:
    """Return the bounds of `trigger_bound`; the entropy of a change to an impossible step is infinite."""
    before = watched.change.before
    nats = nats_per_episode(before, found)
    rates = tuple(level / STEPS for level in LEVELS)
    parts = most_in_time(before, found, SOON, rates, generator)
    return {
        "nats per episode": _finite(nats),
        "least mean delay": math.log(world.settings.steps_per_false_alarm) / nats if nats > 0 else None,
        **{_most_soon(level): part for level, part in zip(LEVELS, parts, strict=True)},
    }


def _most_soon(level: float) -> str:
    return f"most within {SOON} at {level:g} false alarms"


def without_change(alarms: Sequence[int]) -> dict[str, Any]:
    """Return figures of streams of `STEPS` steps, from the number of alarms in each of them."""
    return {
        "streams": len(alarms),
        "steps of each": STEPS,
        "false alarms": sum(alarms),
        "most in a stream": max(alarms),
        "streams with at most one": sum(count <= 1 for count in alarms),
    }


def of_kind(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return figures over the changes of one kind."""
    totals = {name: sum(row[name] for row in rows) for name in ("streams", "alarms", "soon")}
    return {
        "changes": len(rows),
        **totals,
        "alarms before": sum(row["alarms before the change"] for row in rows),
        "alarms in 100,000 steps": (
            totals["alarms"] * STEPS / sum(row["steps"] for row in rows) if rows else None
        ),
        "part within 3": totals["soon"] / totals["streams"] if rows else None,
        "most": max((row["most"] for row in rows if row["most"] is not None), default=None),
    }


def beside_bound(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return figures of the costly changes, beside what any detector can do.

    `possible` are changes of which some detector can see 95 percent within three episodes at the default's
    rate of false alarms, `impossible` those of which none can even with one false alarm in `STEPS` steps.
    """
    costly = [row for row in rows if row["kind"] == "costly"]
    seen = [_is_seen(row) for row in costly]
    most, least = ([row[_most_soon(level)] for row in costly] for level in LEVELS)
    possible = [part >= MOST for part in least]
    return {
        "changes": len(rows),
        "costly": len(costly),
        "least loss": min((row["loss"] for row in costly), default=None),
        "most loss": max((row["loss"] for row in costly), default=None),
        "median delay": _median(costly, "median delay"),
        "least mean delay": _median(costly, "least mean delay"),
        "within 3": _part(costly),
        "at most": float(np.mean(least)) if costly else None,
        "95 percent": sum(seen),
        "possible": sum(possible),
        "of these seen": sum(can and did for can, did in zip(possible, seen, strict=True)),
        "impossible": sum(part < MOST for part in most),
    }


def _is_seen(row: dict[str, Any]) -> bool:
    return bool(row["soon"] >= MOST * row["streams"])


def _part(rows: Sequence[dict[str, Any]]) -> float | None:
    return sum(row["soon"] for row in rows) / sum(row["streams"] for row in rows) if rows else None


def _median(rows: Sequence[dict[str, Any]], name: str) -> float | None:
    """Return the median of the rows' figures; a change that is not seen counts as infinite."""
    values = [math.inf if row[name] is None else row[name] for row in rows]
    return _finite(float(np.median(values))) if rows else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
