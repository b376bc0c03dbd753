"""Maps: what is drawn, where, and that the same input gives the same bytes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from merap.concerns.combination import (
    Capability,
    Combination,
    Condition,
    Environment,
    ExternalAction,
    Innate,
    InnateAction,
    Objective,
    Outcome,
    RewardRule,
)
from merap.concerns.expressions import parse
from merap.concerns.space import Attribute, Space
from tests.hand_made import number

# Ground floor of an office building, metres. S and G1 to G3 are where tasks begin and end.
PLACES = {
    "S": (0, 4),
    "entrance": (3, 4),
    "reception": (6, 4),
    "hall_west": (6, 7.5),
    "hall_middle": (10, 7.5),
    "hall_east": (14, 7.5),
    "gallery": (18, 7.5),
    "A": (10, 4),
    "B": (14, 4),
    "corridor": (18, 4),
    "junction": (21.5, 4),
    "G1": (24.5, 4),
    "C": (6, 0.5),
    "kitchen": (10, 0.5),
    "workshop": (14, 0.5),
    "store": (18, 0.5),
    "ramp": (21.5, 0.5),
    "G2": (24.5, 0.5),
    "office_1": (6, 10.5),
    "office_2": (10, 10.5),
    "meeting_room": (14, 10.5),
    "library": (18, 10.5),
    "stairs": (21.5, 7.5),
    "G3": (24.5, 7.5),
}
ROWS = (
    ("S", "entrance", "reception", "A", "B", "corridor", "junction", "G1"),
    ("hall_west", "hall_middle", "hall_east", "gallery", "stairs", "G3"),
    ("C", "kitchen", "workshop", "store", "ramp", "G2"),
)
COLUMNS = (
    ("office_1", "hall_west", "reception", "C"),
    ("office_2", "hall_middle", "A"),
    ("meeting_room", "hall_east", "B"),
    ("library", "gallery", "corridor", "store"),
    ("stairs", "junction", "ramp"),
)
ONE_WAY = (("workshop", "B", "north"),)
MOVES = ("east", "west", "north", "south")


def floor_plan() -> Space:
    """24 named locations; doors lead both ways, except from the workshop to B."""
    names = tuple(PLACES)
    edges = [edge for row in ROWS for a, b in zip(row, row[1:]) for edge in ((a, b, "east"), (b, a, "west"))]
    edges += [e for column in COLUMNS for a, b in zip(column, column[1:]) for e in ((a, b, "south"), (b, a, "north"))]
    target = np.full((len(names), len(MOVES)), -1, dtype=np.int64)
    for source, destination, label in (*edges, *ONE_WAY):
        target[names.index(source), MOVES.index(label)] = names.index(destination)
    light = np.full(len(names), 2.0)
    light[[names.index(name) for name in ("C", "kitchen", "workshop", "store")]] = [1, 0, 1, 1]
    light[[names.index(name) for name in ("gallery", "hall_east", "library")]] = 3
    slippery = np.isin(names, ["ramp", "kitchen"]).astype(np.float64)
    return Space(
        locations=names,
        positions=np.array(list(PLACES.values()), dtype=np.float64),
        moves=MOVES,
        target=target,
        shape=None,
        attributes=(Attribute("light", "int", 0, 3, light), Attribute("slippery", "bool", 0, 1, slippery)),
        detectors=(),
    )


def where(space: Space, *names: str) -> np.ndarray:
    return np.isin(space.locations, names)


def office(*blocked: str, goal: str = "G3", no_entry: tuple[str, ...] = ("stairs",)) -> Combination:
    space = floor_plan()
    at_goal = where(space, goal)
    moves = [ExternalAction(n, (Outcome(i, number("0.9")), Outcome(None, number("0.1"))), "stay") for i, n in enumerate(MOVES)]
    innate = Innate("scan", 1, 0, frozenset({0, 2}), True, (InnateAction("measure", {1: {2: Fraction(9, 10), 1: Fraction(1, 10)}}),))
    return Combination(
        name=f"met.speed_high.{goal.lower()}",
        space=space,
        modes=("idle", "scanning", "scanned"),
        actions=("stop", *MOVES, "measure", "start_scan"),
        environment=Environment("met", {}, where(space, *blocked), np.zeros_like(space.target, dtype=np.bool_), space.attributes),
        capability=Capability("speed_high", {}, where(space, *no_entry), (ExternalAction("stop", (Outcome(None, number(1)),), "stay"), *moves), innate),
        objective=Objective(
            name=goal.lower(),
            parameters={},
            start=where(space, "S").astype(np.float64),
            horizon=40,
            goal=at_goal,
            rules=(RewardRule(Condition(at=at_goal, modes=np.array([False, False, True]), actions=frozenset({"stop"})), number(20)), RewardRule(Condition(), number(-1))),
            ends_after=Condition(at=at_goal, modes=np.array([False, False, True]), actions=frozenset({"stop"})),
            ends_in=None,
            unsafe=Condition(where=parse("light = 0")),
        ),
        discount=0.98,
        digest="0" * 64,
    )
