"""Give every choice of commands an action of its own, so that the name of an action says what happens.

In PRISM a command may have no action, and several commands of one action may be enabled in one state. In a
program with unique actions neither occurs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import product
from math import prod
from typing import TypeAlias

import numpy as np

from merap.errors import InputError
from merap.program.exploration import Exploration
from merap.program.form import Command, Process, Program, RewardStructure

MAX_COMBINATIONS = 4096
# Process -> for each of its commands of an action the names that it takes part in.
_Split: TypeAlias = Mapping[str, list[list[str]]]


def ambiguous_actions(exploration: Exploration) -> Mapping[str, int]:
    """Return the actions for which some state has more than one choice of commands, and such a state."""
    several: dict[str, list[int]] = {}
    for number, choice in enumerate(exploration.choices):
        if choice.labelled:
            several.setdefault(choice.action, []).append(number)
    found = {
        action: _meeting(exploration, numbers) for action, numbers in several.items() if len(numbers) > 1
    }
    return {action: code for action, code in found.items() if code is not None}


def _meeting(exploration: Exploration, numbers: list[int]) -> int | None:
    """Return the code of a state that has two of some choices; None if there is none."""
    branches = exploration.branches
    place = np.full(len(exploration.choices), -1)
    place[numbers] = np.arange(len(numbers))
    rows = np.flatnonzero(place[branches.choice] >= 0)
    source, choice = exploration.place(branches.source[rows]), place[branches.choice[rows]]
    one = np.full(len(exploration.codes), -1)
    one[source] = choice
    doubled = np.flatnonzero(one[source] != choice)
    return int(exploration.codes[source[doubled[0]]]) if len(doubled) else None


def unique_actions(program: Program, ambiguous: Collection[str] = ()) -> Program:
    """Return the program with an action for every choice of commands.

    A command without an action gets `process#i`; an ambiguous action becomes one for each combination of
    its commands, `action#i.j`. Numbers count, from 1, the commands of a process that have the same action,
    or none. Rewards of an action become those of all that it is split into.

    Args:
        program: as written.
        ambiguous: its actions of which two commands of a process may be enabled at once.

    Raises:
        InputError: an action has more than 4,096 combinations of commands.
    """
    splits = {action: _split(program, action) for action in program.actions if action in ambiguous}
    alone = frozenset(
        f"{process.name}#{number}"
        for process in program.processes
        for number, _ in enumerate((one for one in process.commands if one.action is None), start=1)
    )
    names: dict[str | None, frozenset[str | None]] = {None: frozenset(alone)}
    for action, split in splits.items():
        names[action] = frozenset(name for own in split.values() for named in own for name in named)

    def earned(structure: RewardStructure) -> RewardStructure:
        rules = (
            replace(rule, actions=frozenset(new for one in rule.actions for new in names.get(one, {one})))
            for rule in structure.rules
        )
        return replace(structure, rules=tuple(rules))

    return replace(
        program,
        processes=tuple(
            replace(process, commands=tuple(_commands(process, splits))) for process in program.processes
        ),
        rewards={name: earned(structure) for name, structure in program.rewards.items()},
    )


def _split(program: Program, action: str) -> _Split:
    counts = {
        process.name: sum(command.action == action for command in process.commands)
        for process in program.processes
        if action in process.actions
    }
    if (several := prod(counts.values())) > MAX_COMBINATIONS:
        raise InputError(
            f"{program.name}: the action {action} has {several} combinations of commands, "
            f"at most {MAX_COMBINATIONS} can be told apart"
        )
    names: _Split = {process: [[] for _ in range(count)] for process, count in counts.items()}
    for places in product(*map(range, counts.values())):
        name = f"{action}#{'.'.join(str(place + 1) for place in places)}"
        for process, place in zip(counts, places, strict=True):
            names[process][place].append(name)
    return names


def _commands(process: Process, splits: Mapping[str, _Split]) -> Iterator[Command]:
    met: Counter[str | None] = Counter()
    for command in process.commands:
        place = met[command.action]
        met[command.action] += 1
        if command.action is None:
            yield replace(command, action=f"{process.name}#{place + 1}")
        elif command.action in splits:
            for name in splits[command.action][process.name][place]:
                yield replace(command, action=name)
        else:
            yield command
