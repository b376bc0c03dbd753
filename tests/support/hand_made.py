"""Combinations made by hand, without a case file."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from merap.concerns.combination import (
    Capability,
    Condition,
    DeclaredCombination,
    DeclaredObjective,
    Environment,
    RewardRule,
)
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.innate import Innate, InnateAction
from merap.concerns.location_tables import HERE
from merap.concerns.space import Attribute, Space
from merap.mdp.model import Bools, Ints
from merap.program.expressions import (
    TRUE,
    Column,
    Constant,
    Expression,
    Lookup,
    Table,
    Variable,
    all_of,
    fold,
    parse,
)

SIZE = 9
SHIFTS = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}


def cells(*pairs: tuple[int, int], size: int = SIZE) -> Bools:
    mask = np.zeros(size * size, dtype=np.bool_)
    mask[[row * size + column for row, column in pairs]] = True
    return mask


def grid_space(shape: tuple[int, int] = (SIZE, SIZE)) -> Space:
    rows, columns = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    target = np.full((len(rows), len(SHIFTS)), -1, dtype=np.int64)
    for label, (down, right) in enumerate(SHIFTS.values()):
        row, column = rows + down, columns + right
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        target[:, label] = np.where(inside, row * shape[1] + column, -1)
    return Space(
        locations=tuple(f"r{row}c{column}" for row, column in zip(rows, columns, strict=True)),
        positions=np.stack([columns, -rows], axis=1).astype(np.float64),
        moves=tuple(SHIFTS),
        target=target,
        shape=shape,
        attributes=(),
        detectors=(),
    )


def number(value: float | str) -> Constant:
    return Constant(Fraction(str(value)))


def at(mask: Bools, prime: str = "") -> Expression:
    """Return whether the location, or with a prime that of the successor, is among some."""
    return Lookup(Table("", Column.of(mask)), Variable(HERE + prime, 0))


def parsed(text: str, modes: tuple[str, ...] = ()) -> Expression:
    """Return an expression with the names of modes replaced by their numbers."""
    return fold(parse(text), {name: Fraction(index) for index, name in enumerate(modes)})


def grid_combination(
    *,
    blocked: Bools | None = None,
    no_entry: Bools | None = None,
    goal: tuple[int, int] = (4, 4),
    size: int = SIZE,
) -> DeclaredCombination:
    """Return the paper's 9 x 9 world."""
    space = grid_space((size, size))
    empty = np.zeros(space.num_locations, dtype=np.bool_)
    start = cells((0, 0), size=size).astype(np.float64)
    at_goal = cells(goal, size=size)
    moves = [ExternalAction(name, (Outcome(i, number(1)),), "stay") for i, name in enumerate(SHIFTS)]
    return DeclaredCombination(
        name="e.c.o",
        space=space,
        modes=("ready",),
        actions=("stop", *SHIFTS),
        environment=Environment(
            "e", {}, empty if blocked is None else blocked, np.zeros_like(space.target, dtype=np.bool_), ()
        ),
        capability=Capability(
            "c",
            {},
            empty if no_entry is None else no_entry,
            (ExternalAction("stop", (Outcome(None, number(1)),), "stay"), *moves),
            None,
        ),
        objective=DeclaredObjective(
            name="o",
            parameters={},
            start=start,
            horizon=2 * size,
            goal=at(at_goal),
            rules=(
                RewardRule(Condition(frozenset({"stop"}), at(at_goal)), number(10)),
                RewardRule(Condition(), number("-0.5")),
            ),
            ends_after=Condition(where=at(at_goal)),
            ends_in=None,
            unsafe=None,
        ),
        discount=0.95,
        digest="0" * 64,
    )


def graph_combination() -> DeclaredCombination:
    """Four locations in a ring, every feature of the composition once.

    `east` leads 0 -> 1 -> 2 -> 3, `west` back, `across` 0 -> 2. Location 3 is icy; the automaton
    `scan` has modes idle, scanning, scanned.
    """
    target: Ints = np.array([[1, -1, 2], [2, 0, -1], [3, 1, -1], [-1, 2, -1]])
    ice = Attribute("ice", "bool", 0, 1, np.array([0.0, 0.0, 0.0, 1.0]))
    light = Attribute("light", "int", 0, 3, np.array([3.0, 2.0, 0.0, 2.0]))
    space = Space(
        locations=("S", "A", "B", "G"),
        positions=np.arange(8, dtype=np.float64).reshape(4, 2),
        moves=("east", "west", "across"),
        target=target,
        shape=None,
        attributes=(ice, light),
        detectors=(),
    )
    modes = ("idle", "scanning", "scanned")

    def expression(text: str) -> Expression:
        return parsed(text, modes)

    external = (
        ExternalAction("stop", (Outcome(None, number(1)),), "stay"),
        ExternalAction(
            "go",
            (
                Outcome(0, expression("ice' | light = 3 ? 0.6 : 0.9")),
                Outcome(1, expression("mode = scanned ? 0.05 : 0")),
                Outcome(None, expression("1 - (ice' | light = 3 ? 0.6 : 0.9) - (mode = scanned ? 0.05 : 0)")),
            ),
            "stay",
        ),
        ExternalAction("back", (Outcome(1, number(1)),), "disable"),
        ExternalAction("jump", (Outcome(2, number("0.5")), Outcome(None, number("0.5"))), "disable"),
    )
    innate = Innate(
        name="scan",
        entry=1,
        initial=0,
        terminal=frozenset({0, 2}),
        restart=True,
        actions=(InnateAction("measure", {1: {2: number("0.9"), 1: number("0.1")}}),),
    )
    at_goal, scanned = np.array([False, False, False, True]), expression("mode = scanned")
    scanned_at_goal = all_of([at(at_goal), scanned])
    objective = DeclaredObjective(
        name="o",
        parameters={},
        start=np.array([0.25, 0.75, 0.0, 0.0]),
        horizon=12,
        goal=at(at_goal),
        rules=(
            RewardRule(
                Condition(frozenset({"stop"}), scanned_at_goal),
                number(20),
            ),
            RewardRule(
                Condition(where=all_of([at(at_goal, "'"), parsed("light' > light")])), parsed("light / 4")
            ),
            RewardRule(
                Condition(frozenset({"measure"}), expression("mode' = scanned")),
                number("0.3"),
            ),
            RewardRule(Condition(where=expression("light = 0 & mode = idle")), number(-3)),
            RewardRule(Condition(), number(-1)),
        ),
        ends_after=Condition(frozenset({"stop"}), scanned_at_goal),
        ends_in=all_of([at(np.array([False, True, False, False])), scanned]),
        unsafe=parsed("light = 0"),
    )
    return DeclaredCombination(
        name="e.c.o",
        space=space,
        modes=modes,
        actions=("stop", "go", "back", "jump", "measure", "start_scan"),
        environment=Environment(
            "e", {}, np.zeros(4, dtype=np.bool_), np.zeros((4, 3), dtype=np.bool_), (ice, light)
        ),
        capability=Capability("c", {}, np.zeros(4, dtype=np.bool_), external, innate),
        objective=objective,
        discount=0.9,
        digest="0" * 64,
    )


def with_environment(combination: DeclaredCombination, **changes: Any) -> DeclaredCombination:
    """Return the same with another environment."""
    return replace(combination, environment=replace(combination.environment, **changes))


def with_capability(combination: DeclaredCombination, **changes: Any) -> DeclaredCombination:
    """Return the same with another capability."""
    return replace(combination, capability=replace(combination.capability, **changes))


def with_objective(combination: DeclaredCombination, **changes: Any) -> DeclaredCombination:
    """Return the same with another objective."""
    return replace(combination, objective=replace(combination.objective, **changes))


HAND_MADE = {
    "grid": grid_combination(),
    "obstacles": grid_combination(blocked=cells((1, 2), (3, 2), (4, 1), (6, 1)), no_entry=cells((4, 3))),
    "graph": graph_combination(),
    "one start": with_objective(graph_combination(), start=np.array([1.0, 0, 0, 0])),
    "no end": with_objective(graph_combination(), ends_in=None, ends_after=None),
    "complete at once": with_objective(graph_combination(), ends_in=TRUE),
    "no reward": with_objective(graph_combination(), rules=()),
    "no goal": with_objective(graph_combination(), goal=None),
    "nothing innate": with_capability(graph_combination(), innate=None),
    "nothing external": with_capability(graph_combination(), external=()),
    "all blocked": with_environment(graph_combination(), blocked=np.array([False, False, True, True])),
}
