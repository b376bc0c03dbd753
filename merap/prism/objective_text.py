"""The module `objective`: it owns the flag `done`, and pays."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor

from merap.concerns.combination import Combination, Condition
from merap.concerns.synthesis import least_reward
from merap.mdp.reserved_names import FLAG_VARIABLE, GOAL_LABEL, UNSAFE_LABEL
from merap.prism.lines import Command, Formula, Payment
from merap.prism.location_text import predicate
from merap.prism.step_text import Branch, StepText, StepWriter
from merap.prism.terms import bare


@dataclass(frozen=True)
class ObjectiveText:
    """The content of `objective.prism.j2`.

    Attributes:
        complete: when a state is complete.
        payments: formulas of the expected reward of each action.
        fixed_start: whether `done` carries its `init`.
        commands: one for each action.
        labels: `goal` and, if declared, `unsafe`.
        shift: added to every reward of the structure `objective_shifted`.
    """

    complete: str
    payments: list[Payment]
    fixed_start: bool
    commands: list[Command]
    labels: list[Formula]
    shift: int


def objective_text(writer: StepWriter, *, fixed_start: bool) -> ObjectiveText:
    """The module for one objective."""
    objective = writer.combination.objective
    actions = _actions(writer)
    labels = [Formula(GOAL_LABEL, bare(predicate(writer.space, objective.goal)))]
    if objective.unsafe is not None:
        labels.append(Formula(UNSAFE_LABEL, bare(_in_states(writer, objective.unsafe))))
    return ObjectiveText(
        complete=FLAG_VARIABLE
        if objective.ends_in is None
        else f"{FLAG_VARIABLE} | {_in_states(writer, objective.ends_in)}",
        payments=[Payment(action, bare(writer.pay(steps))) for action, steps in actions.items()],
        fixed_start=fixed_start,
        commands=[Command(action, "!complete", _flag(writer, action)) for action in actions],
        labels=labels,
        shift=_shift(writer.combination),
    )


def _actions(writer: StepWriter) -> dict[str, list[StepText]]:
    """Return each action of this capability, in declared order, and its steps."""
    capability = writer.combination.capability
    actions = {action.name: [writer.external(action)] for action in capability.external}
    if capability.innate is not None:
        innate = capability.innate
        # One that is defined in no mode would fire on its own if it stood here alone.
        actions |= {action.name: writer.innate(action) for action in innate.actions if action.transitions}
        if innate.restart:
            start = Branch("1", mode=innate.entry)
            actions[innate.start_action] = [StepText(innate.start_action, (start,))]
    return actions


def _in_states(writer: StepWriter, condition: Condition) -> str:
    return writer.holds(condition, "", Branch("1"))


def _flag(writer: StepWriter, action: str) -> str:
    ends_after = writer.combination.objective.ends_after
    if ends_after is None:
        return "true"
    condition = writer.holds(ends_after, action, Branch("1"))
    if condition in ("true", "false"):
        return f"({FLAG_VARIABLE}'=true)" if condition == "true" else "true"
    return f"({FLAG_VARIABLE}'=({bare(condition)}))"


def _shift(combination: Combination) -> int:
    """More than the greatest loss a step can bring, as PRISM-games takes no negative reward."""
    return floor(-least_reward(combination)) + 1
