"""A simulated system that changes as a scenario says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from typing import Any

import numpy as np

from merap.concerns.combination import ResetMode
from merap.errors import InputError
from merap.mapek.instrumented import Tally
from merap.mapek.scenario import Moment, Stage
from merap.mapek.scenario_schema import NoiseSpec
from merap.mdp.model import TabularMDP
from merap.strategies.ground_truth import GroundTruth, ground_truth
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from merap.systems.world import Values

# Number of states for which the ground truth of an episode that begins there is kept.
LASTING = 64


class ScenarioSystem:
    """A simulated system whose true model is another at each stage; see
    `instrumented.InstrumentedSystem`.

    A change takes effect when its moment has come and the system is not where the change closes
    the way: until then it waits.

    Args:
        stages: stages of the scenario, in order.
        noise: on rewards and actions.
        reset: how an episode begins; None: as the first system says.
        generator: draws everything.
        threshold: threshold of the shield, for the ground truth; None: there is no shield.

    Raises:
        InputError: a reachable state has no action; names it.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        noise: NoiseSpec,
        reset: ResetMode | None,
        generator: np.random.Generator,
        threshold: float | None = None,
    ) -> None:
        self.stages = tuple(stages)
        truths = [ground_truth(stage.system, noise.slip, threshold) for stage in stages]
        self._truths = truths
        of_system, generator = generator.spawn(2)
        system = stages[0].system
        reset = reset or system.reset
        self._system = SimulatedSystem(
            system, system.objective.horizon, of_system, slip=noise.slip, detect=True, reset=reset
        )
        self._goes_to_start = reset == "episodes"
        self._lasts = reset == "none"
        self._begun: Values | None = None
        self._lasting = lru_cache(maxsize=LASTING)(lambda number, state: truths[number].starting(dict(state)))
        self._noise = noise.reward
        self._generator = generator
        self._number = 0
        self._episode = -1
        self._numbered = False
        self.tally = Tally()

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._system.actions

    @property
    def horizon(self) -> int:
        """Steps of an episode."""
        return self._truths[0].horizon

    @property
    def models(self) -> tuple[TabularMDP, ...]:
        """The whole models of the systems that are met, as they really are."""
        return tuple(truth.whole for truth in self._truths)

    @property
    def stage(self) -> int:
        """The number of the stage in force."""
        return self._number

    @property
    def episode(self) -> int:
        """The number of the episode, counted from 0."""
        return self._episode

    @property
    def truth(self) -> GroundTruth:
        """The system as it really is now, for an episode that begins where this one did."""
        if self._begun is None:
            return self._truths[self._number]
        return self._lasting(self._number, tuple(self._begun.items()))

    def begin(self, episode: int) -> None:
        """Begin the episode with this number, whether or not its reset gets here, and how often.

        Where nobody numbers them, every reset begins the next one.
        """
        self._episode, self._numbered = episode, True
        self.tally = Tally()

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            InputError: none can begin where the system is.
        """
        if not self._numbered:
            self._episode += 1
        self.tally = Tally()
        self._switch(goes_to_start=self._goes_to_start)
        observation = self._system.reset()
        if self._lasts:
            self._begun = self._system.values
        return observation

    def step(self, action: int) -> Observation:
        """Take an action."""
        observation = self._system.step(action)
        self._count(observation)
        if not observation.last and self._switch():
            seen = self._system.look()
            observation = replace(observation, enabled=seen.enabled, detections=seen.detections)
        if self._noise == 0:
            return observation
        return replace(
            observation, reward=observation.reward + self._noise * self._generator.standard_normal()
        )

    def _count(self, observation: Observation) -> None:
        before = self.tally
        discount = self.stages[self._number].system.discount
        self.tally = Tally(
            steps=before.steps + 1,
            earned=before.earned + observation.reward,
            discounted=before.discounted + discount**before.steps * observation.reward,
            unsafe=(before.unsafe or 0) + int(self._system.unsafe),
            completed=observation.continuation == 0,
        )

    def _switch(self, *, goes_to_start: bool = False) -> bool:
        """Go on to the last stage that is due and possible; return whether there is one."""
        now = Moment(self._episode, self.tally.steps)
        due = [number for number, stage in enumerate(self.stages) if stage.begins <= now]
        for number in reversed(due):
            if number <= self._number:
                return False
            system = self.stages[number].system
            if goes_to_start or self._system.fits(system):
                self._number = number
                self._system.switch(system)
                return True
        return False

    def snapshot(self) -> dict[str, Any]:
        """Return all of the state, as JSON has it."""
        return {
            "stage": self._number,
            "episode": self._episode,
            "tally": asdict(self.tally),
            "system": self._system.snapshot(),
            "generator": self._generator.bit_generator.state,
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is none of such a system.
        """
        try:
            self._number, self._episode = int(snapshot["stage"]), int(snapshot["episode"])
            self.tally = Tally(**snapshot["tally"])
            self._system.switch(self.stages[self._number].system)
            self._system.restore(snapshot["system"])
            self._generator.bit_generator.state = snapshot["generator"]
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"the recorded state of the system can't be used: {error}") from error
