"""A declared prior on hazards: locations that may be unsafe though no configuration says so.

Before anything is seen, each location p is hazardous with a declared probability h(p), independently
of all others and for good. To go there is then a violation. In the robust recursion (`fixpoint`) a
step that leads from another location to p counts h(p) + (1 - h(p)) rho: to stay where one is, or
to change the mode there, adds nothing. A hazard is the same each time, so on a way that visits p
twice before it is seen the recursion counts h(p) twice: an upper bound.

Once the system has been at p, or a detector has read there an attribute that `unsafe` depends on,
h(p) becomes the posterior: 0 after a visit that no detector speaks of, Bayes' rule after a reading.
A threshold of 0 forbids every location with h(p) > 0.

Axes: P locations.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from merap.belief.steps import holds_in_states
from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Attribute, Detector
from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.program.expressions.tree import variables


class Hazards:
    """What is believed of unknown hazards; changes with what is seen.

    Args:
        combination: whose `unsafe` tells what a reading means; any of the case.
        prior: h of each location.
        at: the locations it speaks of; None: all but the start.

    Raises:
        InputError: the prior is no probability.
    """

    def __init__(
        self, combination: DeclaredCombination, prior: float, at: Collection[int] | None = None
    ) -> None:
        if not 0 <= prior < 1:
            raise InputError(f"the prior on hazards must be in [0, 1), it is {prior}")
        self._combination = combination
        self.prob: Floats = np.zeros(combination.space.num_locations)
        where = np.flatnonzero(combination.objective.start == 0) if at is None else np.array(sorted(at))
        self.prob[where] = prior
        self._telling = _telling(combination)

    def visit(self, location: int, detections: Mapping[str, object]) -> None:
        """The system is at a location, and its detectors read something."""
        read = [self._read(detector, detections[detector.name]) for detector in self._telling
                if detector.name in detections]  # fmt: skip
        if not any(location in places for places in read):
            self.prob[location] = 0.0

    def _read(self, detector: Detector, readings: object) -> Ints:
        """Bayes' rule with readings, location name -> value; the locations they are of."""
        if not isinstance(readings, Mapping):
            raise InputError(f"the detector {detector.name} reads {readings!r}, not values by location")
        index = self._combination.space.location_index
        places = np.array([index[str(name)] for name in readings], dtype=np.int64)
        values = np.array([float(value) for value in readings.values()])
        seen = _unsafe_if(self._combination, detector.of, places, values)
        right, wrong = detector.accuracy, 1 - detector.accuracy
        hazard = self.prob[places] * np.where(seen, right, wrong)
        none = (1 - self.prob[places]) * np.where(seen, wrong, right)
        # A reading that can't be, of a detector without errors, leaves the belief as it was.
        self.prob[places] = np.where(
            hazard + none > 0, hazard / np.maximum(hazard + none, 1e-300), self.prob[places]
        )
        return places


def _telling(combination: DeclaredCombination) -> list[Detector]:
    """The detectors of attributes that `unsafe` reads."""
    unsafe = combination.objective.unsafe
    read = set() if unsafe is None else {variable.name for variable in variables(unsafe)}
    return [detector for detector in combination.space.detectors if detector.of in read]


def _unsafe_if(combination: DeclaredCombination, attribute: str, places: Ints, values: Floats) -> Bools:
    """bool [places]: the location is unsafe, in some mode, if its attribute has the value read."""
    unsafe = combination.objective.unsafe
    assert unsafe is not None

    def read(one: Attribute) -> Attribute:
        changed = one.values.copy()
        changed[places] = values
        return replace(one, values=changed)

    environment = replace(
        combination.environment,
        attributes=tuple(
            read(one) if one.name == attribute else one for one in combination.environment.attributes
        ),
    )
    states = holds_in_states(replace(combination, environment=environment), unsafe)
    anywhere = np.asarray(states.reshape(combination.space.num_locations, -1).any(axis=1))
    return anywhere[places]
