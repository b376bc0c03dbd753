"""Schema of the scenario file, and its JSON Schema for editors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from merap.concerns.schema import Concern, SystemSpec
from merap.concerns.schema_base import Name, Spec, wrong
from merap.concerns.schema_objective import MAX_HORIZON
from merap.trigger.settings import ChangeTriggerSpec, TriggerSpec

MAX_EPISODES = 1_000_000
MAX_SEED = 2**63 - 1
CONCERNS = ("environment", "capability", "objective")


class MomentSpec(Spec):
    """A moment of the run: after `step` steps of an episode."""

    episode: int = Field(ge=0, lt=MAX_EPISODES, description="counted from 0")
    step: int = Field(default=0, ge=0, lt=MAX_HORIZON, description="steps of it before the moment")


class ChangeSpec(Spec):
    """A change from a moment on; a concern that is not named stays as it was."""

    at: MomentSpec = Field(description="when")
    environment: Concern | None = Field(default=None, description="a configuration's name, or values")
    capability: Concern | None = Field(default=None, description="a configuration's name, or values")
    objective: Concern | None = Field(default=None, description="a configuration's name, or values")

    @model_validator(mode="after")
    def _something_changes(self) -> ChangeSpec:
        if all(getattr(self, concern) is None for concern in CONCERNS):
            raise wrong(f"nothing changes; name at least one of {', '.join(CONCERNS)}")
        return self


class NoiseSpec(Spec):
    """Noise, which makes the system worse than its model."""

    reward: float = Field(
        default=0.0,
        ge=0,
        description="standard deviation of Gaussian noise on rewards; of a system that is not simulated: "
        "what it is known to have",
    )
    slip: float = Field(default=0.0, ge=0, lt=1, description="probability that an action does nothing")


class SensingSpec(Spec):
    """The way of observations to the monitor; the enabled actions and the end of an episode always arrive."""

    delay: int = Field(default=0, ge=0, le=1000, description="steps until an observation arrives")
    loss: float = Field(default=0.0, ge=0, lt=1, description="probability that an observation is lost")


class StrategySpec(Spec):
    """The strategy of the learner."""

    name: str = Field(default="belief", description="as in `merap adapt --strategy`")
    episodes_per_step: int = Field(default=35, ge=1, description="real episodes of a gradient step")
    updates: int = Field(
        default=10,
        ge=1,
        description="policy updates of an adaptation, at least; then the policy is carried out as it is",
    )
    replan_from: Literal["meta", "adapted"] = Field(
        default="meta", description="start of a re-planning: the meta policy, or the adapted one"
    )


class LearningSpec(Spec):
    """Extension of the base: the learner learns offline again."""

    extend: bool = Field(
        default=False,
        description="add the model that an adaptation ends with if the base lacks it, and train further",
    )
    updates: int = Field(default=30, ge=1, le=10_000, description="outer updates after each addition")


class ShieldSpec(Spec):
    """The shield, which leaves the actions that are safe enough."""

    threshold: float = Field(
        default=0.0, ge=0, le=1, description="probability of ever reaching an unsafe state that is accepted"
    )
    hazard_prior: float = Field(
        default=0.0, ge=0, lt=1, description="probability of a location to be unsafe though nothing says so"
    )


class DeadlineSpec(Spec):
    """The deadline of a decision, and the action when the planner is late or the system faults."""

    seconds: float | None = Field(default=None, gt=0, description="for a decision; left out: no limit")
    fallback: Name | None = Field(
        default=None, description="the action that is always safe; left out: the first that is allowed"
    )


class LiveSpec(Spec):
    """A system that is not simulated."""

    horizon: int | None = Field(
        default=None, ge=1, le=MAX_HORIZON, description="steps of an episode; left out: as the objectives say"
    )
    retries: int = Field(default=3, ge=0, le=100, description="of a call that fails")


class HttpSpec(LiveSpec):
    """A system that `merap serve` offers, here or elsewhere."""

    url: str = Field(repr=False, description="where it is, as http://localhost:3000")
    timeout: float = Field(default=5.0, gt=0, description="seconds for a request")


class GymnasiumSpec(LiveSpec):
    """A Gymnasium environment with the actions and the variables of the case."""

    gymnasium: str = Field(description="id of the environment")
    arguments: dict[str, Any] = Field(default={}, repr=False, description="of gymnasium.make")


def _system_kind(value: Any) -> str | None:
    if isinstance(value, str):
        return "<name>"
    if not isinstance(value, Mapping):
        return None
    return "<http>" if "url" in value else "<gymnasium>" if "gymnasium" in value else "<system>"


System = Annotated[
    Annotated[str, Tag("<name>")]
    | Annotated[SystemSpec, Tag("<system>")]
    | Annotated[HttpSpec, Tag("<http>")]
    | Annotated[GymnasiumSpec, Tag("<gymnasium>")],
    Discriminator(
        _system_kind,
        custom_error_type="merap",
        custom_error_message="expected the name of a system, or a mapping with its configurations, "
        "with a url, or with the id of a gymnasium environment",
    ),
]


class ScenarioSpec(Spec):
    """A scenario: a system, and its changes with their moments."""

    scenario: Name = Field(description="the name of the scenario")
    system: System = Field(
        description="the first system: a system of the case, or its configurations, to be simulated; "
        "or one that is not simulated: by url, or as a gymnasium environment"
    )
    episodes: int = Field(ge=1, le=MAX_EPISODES, description="number of episodes")
    seed: int = Field(default=0, ge=0, le=MAX_SEED, description="of everything random")
    changes: tuple[ChangeSpec, ...] = Field(default=(), description="in the order of their moments")
    noise: NoiseSpec = Field(default=NoiseSpec(), description="on rewards and actions")
    sensing: SensingSpec = Field(default=SensingSpec(), description="delayed and lost observations")
    reset: Literal["episodes", "return_to_start", "none"] | None = Field(
        default=None, description="how an episode begins; left out: as the system says"
    )
    strategy: StrategySpec = Field(default=StrategySpec(), description="of the learner")
    learning: LearningSpec = Field(default=LearningSpec(), description="of the learner, offline")
    trigger: TriggerSpec = Field(default=ChangeTriggerSpec(), description="when to re-plan")
    shield: ShieldSpec | None = Field(default=None, description="left out: none")
    deadline: DeadlineSpec = Field(default=DeadlineSpec(), description="of a decision")

    @property
    def live(self) -> LiveSpec | None:
        """The system, if it is not simulated; else None."""
        return self.system if isinstance(self.system, LiveSpec) else None

    @model_validator(mode="after")
    def _live_as_it_is(self) -> ScenarioSpec:
        """Refuse keys that only a simulation can follow, if the system is not simulated."""
        if self.live is None:
            return self
        for path, asked in (
            (("changes",), bool(self.changes)),
            (("noise", "slip"), self.noise.slip > 0),
            (("reset",), self.reset is not None),
        ):
            if asked:
                raise wrong("the system is not simulated: this is up to itself; leave it out", path)
        return self

    @model_validator(mode="after")
    def _in_order(self) -> ScenarioSpec:
        previous = (-1, 0)
        for index, change in enumerate(self.changes):
            moment = (change.at.episode, change.at.step)
            if moment <= previous:
                raise wrong("a change must come after the one before it", ("changes", index, "at"))
            if change.at.episode >= self.episodes:
                message = f"there are {self.episodes} episodes, the last is {self.episodes - 1}"
                raise wrong(message, ("changes", index, "at", "episode"))
            previous = moment
        return self


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file (draft 2020-12)."""
    schema = ScenarioSpec.model_json_schema(mode="validation")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "merap scenario file",
    }
