"""Draw the readings of a case's detectors where the system is.

A reading is right with the detector's accuracy, independently of all others. A wrong one of an attribute
with several values is any other of them; of a real attribute any number of its range.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Attribute, Detector, Space
from merap.mdp.model import Floats, Ints

Reading = bool | int | float


def detections(
    combination: DeclaredCombination, location: int, generator: np.random.Generator
) -> dict[str, Mapping[str, Reading]]:
    """Draw one reading of every detector for each location that it sees.

    Args:
        combination: whose obstacles and attributes are there.
        location: index of the location where the system is.
        generator: draws wrong readings.

    Returns:
        Name of a detector -> {name of a location: the reading there}.
    """
    return {
        detector.name: _readings(combination, detector, location, generator)
        for detector in combination.space.detectors
    }


def seen_locations(space: Space, location: int, reach: int) -> Ints:
    """Return int64, ascending: the location and all that are up to `reach` edges away."""
    seen = np.array([location], dtype=np.int64)
    for _ in range(reach):
        following = space.target[seen].ravel()
        seen = np.union1d(seen, following[following >= 0])
    return seen


def _readings(
    combination: DeclaredCombination, detector: Detector, location: int, generator: np.random.Generator
) -> dict[str, Reading]:
    seen = seen_locations(combination.space, location, detector.range)
    attribute = _attribute(combination, detector.of)
    actual = attribute.values[seen]
    right = generator.random(len(seen)) < detector.accuracy
    read = np.where(right, actual, _wrong(attribute, actual, generator))
    kind = {"bool": bool, "int": int, "real": float}[attribute.kind]
    names = combination.space.locations
    return {names[index]: kind(value) for index, value in zip(seen, read, strict=True)}


def _attribute(combination: DeclaredCombination, name: str) -> Attribute:
    environment = combination.environment
    if name == "blocked":
        return Attribute(name, "bool", 0, 1, environment.blocked.astype(np.float64))
    return next(attribute for attribute in environment.attributes if attribute.name == name)


def _wrong(attribute: Attribute, actual: Floats, generator: np.random.Generator) -> Floats:
    """Return float64 like `actual`: any other value, each equally likely."""
    if attribute.kind == "real":
        return generator.uniform(attribute.low, attribute.high, len(actual))
    count = int(attribute.high - attribute.low) + 1
    shift = generator.integers(1, max(count, 2), len(actual))
    other: Floats = attribute.low + (actual - attribute.low + shift) % count
    return other
