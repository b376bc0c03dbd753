"""The settings of a trigger, validated once; a scenario file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from merap.errors import InputError


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class WindowSettings(_Settings):
    """The paper's trigger: re-plan if a window's discounted reward is below TR."""

    kind: Literal["window"] = "window"
    threshold: float = Field(description="TR, the least discounted reward of a window")
    discount: float = Field(default=0.95, gt=0, le=1, description="of each step from the window's start")
    steps: int | None = Field(
        default=None, ge=1, description="T2 - T1 + 1, the length of a window; left out: an episode"
    )
    sliding: bool = Field(
        default=False, description="a window ends at every step, not only where the one before it ended"
    )


class ChangeSettings(_Settings):
    """A change detector: re-plan if the model no longer holds, and the policy is worth less for it."""

    kind: Literal["change"] = "change"
    noise: float = Field(default=0.1, gt=0, description="standard deviation of the noise on rewards")
    tails: Literal["gaussian", "symmetric"] = Field(
        default="gaussian",
        description="of that noise; symmetric: any noise that is as often too high as too low, of any size",
    )
    floor: float = Field(
        default=1e-5, gt=0, lt=1, description="probability that a step does what the model holds impossible"
    )
    odds: tuple[Annotated[float, Field(ge=1)], ...] = Field(
        default=(2.5, 7.0),
        min_length=1,
        description="changes watched for everywhere: "
        "all but the likeliest successor have that many times the odds",
    )
    share: float = Field(
        default=1e-3, gt=0, lt=1, description="of a watched change: part of its steps that can do anything"
    )
    local: float = Field(
        default=0.01, gt=0, lt=1, description="chance per visit of a change at one state and action alone"
    )
    steps_per_false_alarm: float = Field(
        default=1e6, gt=1, description="without a change, at least that many steps on average per alarm"
    )
    release: float = Field(
        default=0.5,
        ge=0,
        lt=1,
        description="a suspicion is dropped once the evidence falls to this part of the threshold",
    )
    max_evidence: float = Field(
        default=7.0, gt=0, description="that a single step can add, in natural logarithms"
    )
    tolerated_loss: float = Field(
        default=0.1, ge=0, description="of an episode's value, as a part of it, that is put up with"
    )
    deviations: float = Field(
        default=2.5, gt=0, description="standard deviations by which the loss must exceed what is tolerated"
    )
    longest: int = Field(
        default=200, ge=1, description="steps after which an episode is judged though it is not over"
    )
    cooldown: int = Field(default=2, ge=0, description="episodes after a re-planning without an alarm")
    budget: int = Field(default=5, ge=1, description="re-plannings within `budget_steps`")
    budget_steps: int = Field(default=2000, ge=1, description="steps for which a re-planning uses the budget")


class NoTrigger(_Settings):
    """Never re-plan."""

    kind: Literal["none"] = "none"


TriggerSettings: TypeAlias = Annotated[
    ChangeSettings | WindowSettings | NoTrigger, Field(discriminator="kind")
]
_ADAPTER: TypeAdapter[ChangeSettings | WindowSettings | NoTrigger] = TypeAdapter(TriggerSettings)


def read_trigger(kind: str, given: Mapping[str, Any]) -> ChangeSettings | WindowSettings | NoTrigger:
    """Settings from a file.

    Args:
        kind: `change`, `window` or `none`.
        given: the settings that differ from the defaults.

    Raises:
        InputError: no such kind or setting, or a value that is not allowed; names it.
    """
    try:
        return _ADAPTER.validate_python({**given, "kind": kind})
    except ValidationError as error:
        first = error.errors()[0]
        place = [str(part) for part in first["loc"] if part != kind]
        key = ".".join(("trigger", *place))
        raise InputError(f"{first['msg']}, got {first['input']!r}", key=key) from error
