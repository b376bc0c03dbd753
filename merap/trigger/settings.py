"""The settings of a trigger, validated once; a scenario file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from merap.concerns.schema_base import Spec, shown, wrong
from merap.program.names import suggestion

KINDS = ("change", "window", "none")


class WindowSettings(Spec):
    """The paper's trigger: re-plan if a window's discounted reward is below TR."""

    threshold: float = Field(description="TR, the least discounted reward of a window")
    discount: float | None = Field(
        default=None, gt=0, le=1, description="of each step from the window's start; left out: the case's"
    )
    steps: int | None = Field(
        default=None, ge=1, description="T2 - T1 + 1, the length of a window; left out: an episode"
    )
    sliding: bool = Field(
        default=False, description="a window ends at every step, not only where the one before it ended"
    )

    @property
    def per_step(self) -> float:
        """The discount; 1 where there is no case to have one."""
        return 1.0 if self.discount is None else self.discount


class ChangeSettings(Spec):
    """A change detector: re-plan if the model no longer holds, and the policy is worth less for it."""

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


class ChangeTriggerSpec(Spec):
    """A change detector."""

    kind: Literal["change"] = Field(default="change", description="which trigger")
    settings: ChangeSettings = Field(default=ChangeSettings(), description="where they are not the defaults")


class WindowTriggerSpec(Spec):
    """The paper's trigger."""

    kind: Literal["window"] = Field(description="which trigger")
    settings: WindowSettings = Field(description="the threshold, and how long a window is")


class NoTriggerSpec(Spec):
    """Never re-plan."""

    kind: Literal["none"] = Field(description="which trigger")

    @property
    def settings(self) -> None:
        """There are none."""


def _trigger_kind(value: Any) -> str | None:
    return f"<{value.get('kind', 'change')}>" if isinstance(value, Mapping) else None


def _known_trigger(value: Any) -> Any:
    kind = value.get("kind", "change") if isinstance(value, Mapping) else "change"
    if kind not in KINDS:
        near = suggestion(kind, KINDS) if isinstance(kind, str) else f"; known: {', '.join(KINDS)}"
        raise wrong(f"there is no trigger {shown(kind)}{near}", ("kind",))
    if kind == "window" and "settings" not in value:
        raise wrong("a window needs settings with a threshold")
    return value


TriggerSpec = Annotated[
    Annotated[ChangeTriggerSpec, Tag("<change>")]
    | Annotated[WindowTriggerSpec, Tag("<window>")]
    | Annotated[NoTriggerSpec, Tag("<none>")],
    Discriminator(
        _trigger_kind,
        custom_error_type="merap",
        custom_error_message="expected a mapping with kind and settings",
    ),
    BeforeValidator(_known_trigger),
]
