"""Schema of the capability: external actions and the innate automaton."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from merap.concerns.schema_base import Name, Number, Spec, Truth, shown, wrong
from merap.concerns.schema_processes import Sets

STAY = "stay"


def _one(value: Any) -> int:
    if value == 1 and not isinstance(value, bool):
        return 1
    raise wrong(f"expected 1, the probability of staying, got {shown(value)}")


One = Annotated[int, PlainValidator(_one), WithJsonSchema({"const": 1})]


class OutcomeSpec(Spec):
    """One thing an action can lead to."""

    move: Name = Field(default=STAY, description="along the edge with this label, or `stay`")
    probability: Number = Field(description="a number or an expression")
    sets: Sets = Field(default={}, description="process: what becomes of it with this outcome")


class ActionSpec(Spec):
    """An action. Give `move` or `outcomes`; without either, or with `stay: 1`, it stays."""

    stay: One | None = Field(default=None, description="1: the action leaves the location unchanged")
    move: Name | None = Field(default=None, description="along the edge with this label")
    probability: Number | None = Field(default=None, description="of the move; 1 if left out")
    otherwise: Name | None = Field(
        default=None, description="what else happens: `stay` (default) or an edge label"
    )
    outcomes: tuple[OutcomeSpec, ...] | None = Field(
        default=None, min_length=1, description="all that can happen; the first is what is intended"
    )
    on_blocked: Literal["stay", "disable"] = Field(
        default="stay", description="where the intended move is blocked: stay there, or be without the action"
    )
    requires: Truth = Field(
        default=True,
        description="condition on parameters and state; where it is false the action is disabled",
    )
    sets: Sets = Field(
        default={}, description="process: what becomes of it with this action, before its own changes"
    )

    @model_validator(mode="after")
    def _one_form(self) -> ActionSpec:
        forms = [key for key in ("stay", "move", "outcomes") if getattr(self, key) is not None]
        if len(forms) > 1:
            raise wrong(f"give one of stay, move and outcomes, not {' and '.join(forms)}")
        for key in ("probability", "otherwise"):
            if self.move is None and getattr(self, key) is not None:
                raise wrong(f"{key} goes with move", (key,))
        return self


class InnateSpec(Spec):
    """The innate automaton: modes of the system itself and the actions that change them."""

    name: Name = Field(description="of the automaton; `start_<name>` enters it")
    modes: tuple[Name, ...] = Field(min_length=1, description="its states")
    entry: str | None = Field(
        default=None, description="the mode start_<name> leads to, q0 of the paper; left out: the first"
    )
    initial: str | None = Field(
        default=None, description="the mode an episode begins in; left out: the first"
    )
    terminal: tuple[str, ...] | None = Field(
        default=None, min_length=1, description="modes with external actions; left out: all"
    )
    restart: bool | None = Field(
        default=None, description="whether start_<name> exists; left out: if not all modes are terminal"
    )
    actions: dict[Name, dict[str, dict[str, Number]]] = Field(
        default={}, description="action: (mode: (next mode: probability)); undefined elsewhere"
    )
    requires: Truth = Field(
        default=True,
        description="condition on parameters and state; where it never holds the automaton is lacking",
    )


def restarts(spec: InnateSpec) -> bool:
    """Return whether `start_<name>` exists."""
    if spec.restart is not None:
        return spec.restart
    return spec.terminal is not None and not set(spec.modes) <= set(spec.terminal)
