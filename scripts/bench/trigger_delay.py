"""How long triggers take to see a change, and how often they see one that is not there.

A policy that is best for a known combination is carried out; then another combination is there. Delays
are in episodes: 1 is the episode in which the change came.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.mdp.model import Floats, TabularMDP
from merap.trigger.readings import ObservedSteps, Readings, joined
from merap.trigger.settings import ChangeSettings, WindowSettings
from scripts.bench.trigger_batch import first_alarm, trace, window_rewards
from scripts.bench.trigger_streams import Effect, Known, Noise, effect, gaussian, known, placed, stream

# A loss of that part of the value must be seen.
COSTLY = 0.2
NOTHING = 1e-9
# Episodes before a change, in which evidence settles to what is usual without one.
BEFORE = 30
KINDS = ("costly", "small", "harmless", "off the path")


@dataclass(frozen=True)
class World:
    """What is really there, and what is stated of it.

    Attributes:
        slip: stated, so part of the known model.
        noise: standard deviation of the noise on rewards that is stated.
        real_slip: None: as stated.
        real_noise: None: Gaussian, as stated.
        lost: probability that a step is not seen.
        tails: of the noise, as stated.
    """

    slip: float = 0.1
    noise: float = 0.5
    real_slip: float | None = None
    real_noise: Noise | None = None
    lost: float = 0.0
    tails: Literal["gaussian", "symmetric"] = "gaussian"

    @property
    def settings(self) -> ChangeSettings:
        """The detector's defaults, with the stated noise."""
        return ChangeSettings(noise=self.noise, tails=self.tails)

    def model(self, combination: Combination) -> TabularMDP:
        """Return the model of the combination as it really is."""
        return placed(combination, self.slip if self.real_slip is None else self.real_slip)

    def episodes(
        self, before: Known, real: TabularMDP, count: int, generator: np.random.Generator
    ) -> ObservedSteps:
        """Draw episodes as they are really seen, but for those that are lost."""
        return stream(before, real, count, self.real_noise or gaussian(self.noise), generator)

    def seen(self, readings: Readings, generator: np.random.Generator) -> Readings:
        """Return readings without the lost ones."""
        if self.lost == 0:
            return readings
        return readings.part(generator.random(len(readings)) >= self.lost)


@dataclass(frozen=True, eq=False)
class Change:
    """A known combination, and what is there after a change.

    Attributes:
        name: of both.
        before: what is known.
        same: what is really there before the change.
        real: what is there after it.
        effect: on the policy that is carried out.
    """

    name: str
    before: Known
    same: TabularMDP
    real: TabularMDP
    effect: Effect

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        if not self.effect.visited:
            return "off the path"
        if self.effect.loss >= COSTLY:
            return "costly"
        return "small" if self.effect.loss > NOTHING else "harmless"


@dataclass(frozen=True, eq=False)
class Watched:
    """Streams of one change, before and after it.

    Attributes:
        change: what changes.
        streams: one for each seed: the readings, and the number of steps before the change.
    """

    change: Change
    streams: tuple[tuple[Readings, int], ...] = field(repr=False)


def changes(case: CaseStudy, count: int, world: World, generator: np.random.Generator) -> Iterator[Change]:
    """Draw combinations, and for each another one that differs in one concern or in any.

    Args:
        case: the case.
        count: how many.
        world: what is stated.
        generator: of what is drawn.
    """
    for number in range(count):
        indices = [int(generator.integers(size)) for size in case.shape]
        old, new = case.combine(*indices), _other(case, indices, number, generator)
        before = known(old, world.slip)
        real = world.model(new)
        yield Change(f"{old.name} -> {new.name}", before, world.model(old), real, effect(before, real))


def _other(
    case: CaseStudy, known_one: Sequence[int], number: int, generator: np.random.Generator
) -> Combination:
    """Draw another combination; in turn one concern changes alone, or all do."""
    indices = list(known_one)
    variable = [concern for concern, size in enumerate(case.shape) if size > 1]
    turn = number % (len(variable) + 1)
    changing = variable if turn == len(variable) else [variable[turn]]
    for concern in changing:
        size = case.shape[concern]
        indices[concern] = (indices[concern] + int(generator.integers(1, size))) % size
    return case.combine(*indices)


def wear(
    case: CaseStudy, slip: float, count: int, world: World, generator: np.random.Generator
) -> Iterator[Change]:
    """Draw combinations, and let each of them slip more: a loss in small parts, all over the way.

    Args:
        case: the case.
        slip: after the change.
        count: how many.
        world: what is stated, and there before the change.
        generator: of what is drawn.
    """
    for combination in case.sample(count, generator):
        before = known(combination, world.slip)
        real = placed(combination, slip)
        name = f"{combination.name}, slip {slip}"
        yield Change(name, before, world.model(combination), real, effect(before, real))


def watch(change: Change, world: World, seeds: int, episodes: int, generator: np.random.Generator) -> Watched:
    """Draw streams of a change.

    Args:
        change: what changes.
        world: slip and noise, stated and real.
        seeds: how many streams.
        episodes: after the change.
        generator: of all draws.
    """
    forecast = change.before.forecast(world.settings)
    streams = []
    for _ in range(seeds):
        parts = [
            world.seen(forecast.read(world.episodes(change.before, model, count, generator)), generator)
            for model, count in ((change.same, BEFORE), (change.real, episodes))
        ]
        streams.append((joined(*parts), len(parts[0])))
    return Watched(change, tuple(streams))


def change_delays(watched: Watched, settings: ChangeSettings, log_threshold: float | None = None) -> Floats:
    """Return float64 [seeds], episodes until the alarm; infinite without one, NaN if it came too early."""
    alarms = [
        first_alarm(trace(settings, readings), settings, log_threshold) for readings, _ in watched.streams
    ]
    return _delays(watched, alarms)


def window_delays(watched: Watched, settings: WindowSettings) -> Floats:
    """Return the same for the paper's trigger; alarms before the change are passed over."""
    alarms = []
    for readings, begin in watched.streams:
        ends, rewards = window_rewards(settings, readings)
        missed = ends[(rewards < settings.threshold) & (ends >= begin)]
        alarms.append(int(missed[0]) if len(missed) else None)
    return _delays(watched, alarms)


def _delays(watched: Watched, alarms: Sequence[int | None]) -> Floats:
    found = np.full(len(alarms), np.inf)
    for number, (alarm, (readings, begin)) in enumerate(zip(alarms, watched.streams, strict=True)):
        if alarm is not None:
            found[number] = math.nan if alarm < begin else 1 + readings.last[begin:alarm].sum()
    return found


def unchanged(
    before: Known, same: TabularMDP, world: World, steps: int, generator: np.random.Generator
) -> Readings:
    """Draw at least that many steps without a change; `count_alarms` counts a detector's alarms in them."""
    count = 1 + steps // 10
    readings: Readings | None = None
    while readings is None or len(readings) < steps:
        drawn = world.episodes(before, same, count, generator)
        more = world.seen(before.forecast(world.settings).read(drawn), generator)
        readings = more if readings is None else joined(readings, more)
    return readings.part(slice(0, steps))
