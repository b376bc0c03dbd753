"""Compose a combination: its three concerns as one program.

The rules have numbers: 1 external actions, 2 where they are enabled, 3 innate actions, 4 rewards and ends.
Three processes step together with those that the case declares: `space` owns the location and draws every
outcome of external actions, `capability` owns the mode and says where external actions are enabled,
`objective` owns `done` and stops all others in complete states. A case without space has no process `space`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from merap.concerns.action_sets import joint_outcomes, with_sets
from merap.concerns.location_tables import LocationTables, is_mode, mode_in
from merap.concerns.processes import as_process, linked
from merap.mdp.model import Floats
from merap.mdp.reserved_names import (
    COMPLETE_LABEL,
    END_ACTION,
    FLAG_VARIABLE,
    GOAL_LABEL,
    MODE_VARIABLE,
    UNSAFE_LABEL,
)
from merap.program.expressions import (
    FALSE,
    ONE,
    TRUE,
    Constant,
    Expression,
    Variable,
    all_of,
    any_of,
    negation,
    number,
)
from merap.program.form import (
    Command,
    InitialValues,
    Process,
    Program,
    RewardItem,
    RewardStructure,
    StateVariable,
    Update,
    boolean,
    integer,
)
from merap.program.names import unique_name

if TYPE_CHECKING:
    from merap.concerns.combination import Condition, DeclaredCombination
    from merap.concerns.external_action import ExternalAction, Outcome
    from merap.concerns.innate import InnateAction


def compose(combination: DeclaredCombination) -> Program:
    """Return the program of a combination; its reward structures are `objective` and `steps`."""
    tables = LocationTables(combination)
    complete = _complete(combination, tables)
    objective = combination.objective
    labels = {COMPLETE_LABEL: complete, GOAL_LABEL: FALSE}
    declared = {GOAL_LABEL: objective.goal, UNSAFE_LABEL: objective.unsafe, **objective.labels}
    labels |= {name: tables.read(where) for name, where in declared.items() if where is not None}
    processes = combination.processes
    taken = {*combination.actions, *(one.name for one in processes)}
    taken |= {variable.name for one in processes for variable in one.variables}
    rewards = {
        "objective": RewardStructure(
            tuple(_rules(combination, tables)), first_match=True, shift=unique_name("shift", taken)
        ),
        "steps": RewardStructure((RewardItem(ONE, negation(complete)),)),
    }
    return Program(
        combination.name,
        _processes(
            combination,
            tables,
            _space(combination, tables, combination.objective.start),
            _objective(combination, tables, complete),
        ),
        labels,
        rewards,
        location=combination.space.variable_names,
        definitions={"complete": complete, **tables.successors()},
        monitors=frozenset(
            {FLAG_VARIABLE}
            | {one.name for process in combination.objective.processes for one in process.variables}
        ),
        flag=FLAG_VARIABLE,
    )


def _processes(
    combination: DeclaredCombination, tables: LocationTables, space: Process, last: Process
) -> tuple[Process, ...]:
    """Return all processes: space, environment, capability, objective; those that are linked are one."""
    actions = _actions(combination)
    declared = [tables.read_process(one) for one in with_sets(combination)]
    joint = {
        action.name: joint_outcomes(
            action.mapped(tables.read), declared, space, combination.environment.locked
        )
        for action in combination.capability.external
        if action.is_joint
    }
    own: dict[str, list[Process]] = {"environment": [], "capability": [], "objective": []}
    for one in declared:
        decided = {action for action, outcomes in joint.items() if one.name in outcomes[0]}
        own[one.concern].append(as_process(one, actions, decided))
    capability = _capability(combination, tables)
    order = [space, *own["environment"], capability, *own["capability"], *own["objective"], last]
    return linked([one for one in order if one.variables or one.commands], declared, joint)


def _command(action: str, guard: Expression, *outcomes: Update) -> Command:
    return Command(action, guard, (outcomes or (Update(ONE),),), f"[{action}]")


# --- space: rule 1 ---


def _space(combination: DeclaredCombination, tables: LocationTables, start: Floats) -> Process:
    space = combination.space
    bounds = zip(space.variable_names, space.valuations.max(axis=0).tolist(), strict=True)
    return Process(
        "space",
        "environment",
        tuple(_coordinate(combination, name, high) for name, high in bounds),
        tuple(
            _external(action, tables)
            for action in combination.capability.external
            if space.located or action.is_joint
        ),
        tuple(
            InitialValues(
                number(float(start[place])),
                {
                    name: number(value)
                    for name, value in zip(
                        space.variable_names, space.valuations[place].tolist(), strict=True
                    )
                },
            )
            for place in np.flatnonzero(start).tolist()
        ),
        f"environment {combination.environment.name}: where the system is",
    )


def _coordinate(combination: DeclaredCombination, name: str, high: int) -> StateVariable:
    """Return a location variable; on a graph its values have the names of the locations."""
    if combination.space.shape is not None:
        return integer(name, 0, high)
    return replace(integer(name, 0, high), kind="named", values=combination.space.locations)


def _external(action: ExternalAction, tables: LocationTables) -> Command:
    intended = action.outcomes[0].move
    disables = action.on_blocked == "disable" and intended is not None
    return _command(
        action.name,
        tables.open(intended) if disables and intended is not None else TRUE,
        *(_outcome(outcome, intended, tables) for outcome in action.outcomes),
    )


def _outcome(outcome: Outcome, intended: int | None, tables: LocationTables) -> Update:
    assignments = {} if outcome.move is None else tables.successor(outcome.move)
    return Update(tables.intended(outcome.probability, intended), assignments)


# --- capability: rules 2 and 3 ---


def _capability(combination: DeclaredCombination, tables: LocationTables) -> Process:
    capability, modes = combination.capability, combination.modes
    terminal = mode_in(np.flatnonzero(capability.terminal(len(modes))).tolist(), len(modes))
    commands = [
        _command(action.name, all_of([terminal, tables.read(action.requires)]))
        for action in capability.external
    ]
    if capability.innate is not None:
        innate = capability.innate
        requires = tables.read(innate.requires)
        commands += [command for action in innate.actions for command in _innate(action, requires)]
        if innate.restart:
            guard = all_of([terminal, requires])
            commands.append(_command(innate.start_action, guard, _to_mode(ONE, innate.entry)))
    return Process(
        "capability",
        "capability",
        (replace(integer(MODE_VARIABLE, 0, len(modes) - 1), kind="named", values=modes),) if modes else (),
        tuple(commands),
        (InitialValues(ONE, {MODE_VARIABLE: number(capability.initial_mode)} if modes else {}),),
        f"capability {capability.name}: what the system can do",
    )


def _innate(action: InnateAction, requires: Expression) -> Iterator[Command]:
    for mode, row in action.chances.items():
        outcomes = [_to_mode(Constant(chance), successor) for successor, chance in row.items()]
        yield _command(action.name, all_of([is_mode(mode), requires]), *outcomes)


def _to_mode(chance: Expression, mode: int) -> Update:
    return Update(chance, {MODE_VARIABLE: number(mode)})


# --- objective: rule 4 ---


def _actions(combination: DeclaredCombination) -> list[str]:
    """Return the actions of this capability, in declared order; an innate one may be defined nowhere."""
    capability = combination.capability
    names = [action.name for action in capability.external]
    if capability.innate is not None:
        names += [action.name for action in capability.innate.actions if action.transitions]
        names += [capability.innate.start_action] if capability.innate.restart else []
    return names


def _complete(combination: DeclaredCombination, tables: LocationTables) -> Expression:
    flag = Variable(FLAG_VARIABLE, 0)
    ends_in = combination.objective.ends_in
    return flag if ends_in is None else any_of([flag, tables.read(ends_in)])


def _objective(combination: DeclaredCombination, tables: LocationTables, complete: Expression) -> Process:
    going = negation(complete)
    commands = [
        _command(action, going, *_flagged(combination.objective.ends_after, action, tables))
        for action in _actions(combination)
    ]
    return Process(
        "objective",
        "objective",
        (boolean(FLAG_VARIABLE),),
        (*commands, _command(END_ACTION, complete)),
        (InitialValues(ONE, {FLAG_VARIABLE: FALSE}),),
        f"objective {combination.objective.name}: what the user wants",
    )


def _flagged(ends_after: Condition | None, action: str, tables: LocationTables) -> list[Update]:
    if ends_after is None or (ends_after.actions is not None and action not in ends_after.actions):
        return []
    return [Update(ONE, {FLAG_VARIABLE: tables.read(ends_after.where)})]


def _rules(combination: DeclaredCombination, tables: LocationTables) -> Iterator[RewardItem]:
    """Yield the rules, each for the actions that it is about; `end` earns nothing."""
    known = frozenset(_actions(combination))
    for rule in combination.objective.rules:
        actions = known if rule.condition.actions is None else known & rule.condition.actions
        if actions:
            yield RewardItem(tables.read(rule.value), tables.read(rule.condition.where), actions)
