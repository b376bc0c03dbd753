"""The module `capability`: it owns the mode and says where external actions are enabled."""

from __future__ import annotations

from dataclasses import dataclass

from merap.concerns.combination import Innate
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.prism.lines import Command, VariableLine
from merap.prism.step_text import StepText, StepWriter
from merap.prism.terms import bare


@dataclass(frozen=True)
class CapabilityText:
    """The content of `capability.prism.j2`.

    Attributes:
        mode_key: comment that numbers the modes.
        variables: the mode.
        commands: external actions, then innate ones.
    """

    mode_key: str
    variables: list[VariableLine]
    commands: list[Command]


def capability_text(writer: StepWriter, *, fixed_start: bool) -> CapabilityText:
    """The module; without `init` where there are several initial states."""
    combination = writer.combination
    capability = combination.capability
    guard = bare(writer.mode_in(capability.terminal(len(combination.modes))))
    initial = capability.initial_mode if fixed_start else None
    return CapabilityText(
        mode_key=", ".join(f"{index} {name}" for index, name in enumerate(combination.modes)),
        variables=[VariableLine(MODE_VARIABLE, max(1, len(combination.modes) - 1), initial)],
        commands=[
            *(Command(action.name, guard, "true") for action in capability.external),
            *(_innate(writer, capability.innate, guard) if capability.innate else []),
        ],
    )


def _innate(writer: StepWriter, innate: Innate, in_terminal_mode: str) -> list[Command]:
    commands = [
        Command(step.action, f"{MODE_VARIABLE}={step.mode}", _updates(step))
        for action in innate.actions
        for step in writer.innate(action)
    ]
    if innate.restart:
        commands.append(Command(innate.start_action, in_terminal_mode, f"({MODE_VARIABLE}'={innate.entry})"))
    return commands


def _updates(step: StepText) -> str:
    if len(step.branches) == 1:
        return f"({MODE_VARIABLE}'={step.branches[0].mode})"
    return " + ".join(f"{branch.probability} : ({MODE_VARIABLE}'={branch.mode})" for branch in step.branches)
