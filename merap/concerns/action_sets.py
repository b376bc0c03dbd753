"""Place what actions set before the changes that processes declare themselves."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from merap.concerns.external_action import ExternalAction
from merap.concerns.processes import DeclaredProcess, draw_of
from merap.program.form import Draw, Process

if TYPE_CHECKING:
    from merap.concerns.combination import DeclaredCombination


def with_sets(combination: DeclaredCombination) -> Iterator[DeclaredProcess]:
    """Yield the declared processes, what actions set before their own changes; locked doors never change."""
    for process in combination.processes:
        placed = [
            replace(change, actions=frozenset({action.name}))
            for action in combination.capability.external
            for name, change in action.sets
            if name == process.name
        ]
        locked = process.name in combination.environment.locked
        yield replace(process, changes=() if locked else (*placed, *process.changes))


def joint_outcomes(
    action: ExternalAction, declared: Sequence[DeclaredProcess], space: Process, locked: Collection[str]
) -> list[dict[str, Draw]]:
    """Return for each outcome of an action what the space and the processes that some outcome sets draw.

    Args:
        action: over the location variables.
        declared: with what actions set.
        space: draws the outcomes of the action.
        locked: names of doors that never change.
    """
    (command,) = (one for one in space.commands if one.action == action.name)
    decided = {name for outcome in action.outcomes for name, _ in outcome.sets if name not in locked}
    changed = [one for one in declared if one.name in decided]
    return [
        {
            space.name: (update,),
            **{
                one.name: draw_of(
                    [*(own for name, own in outcome.sets if name == one.name), *one.changes_with(action.name)]
                )
                for one in changed
            },
        }
        for outcome, update in zip(action.outcomes, command.draws[0], strict=True)
    ]
