"""Measure evidence about hypotheses: steps on a grid with 10^4 places are taken in, without a model."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial

import numpy as np

from merap.mdp.model import Ints
from merap.program.evidence import Evidence
from merap.program.expressions import parse
from merap.program.form import (
    Command,
    InitialValues,
    Process,
    Program,
    RewardItem,
    RewardStructure,
    Update,
    integer,
)
from merap.program.hypotheses import Hypotheses

SIDE, STEPS = 100, 300
FLAT, BY_CONCERN = (100, 1_000, 10_000, 100_000), ((100, 10), (10_000, 100))
NOISES = np.array([1e-5, 0.01, 0.1])
MOVES = {
    "north": ("row", "row - 1"),
    "south": ("row", "row + 1"),
    "west": ("col", "col - 1"),
    "east": ("col", "col + 1"),
}


def evidence_figures() -> dict[str, float]:
    """Milliseconds of a step: what is enabled, where it leads, what it earns; in new places and again."""
    figures: dict[str, float] = {}
    for count in FLAT:
        one_axis = {**_environment(count), **_capability(count)}
        figures |= _figures(f"evidence_{count}", [one_axis])
    for environments, capabilities in BY_CONCERN:
        apart = [_environment(environments), _capability(capabilities)]
        figures |= _figures(f"evidence_{environments}x{capabilities}", apart)
    return figures


def _figures(name: str, axes: Sequence[dict[str, Sequence[Fraction]]]) -> dict[str, float]:
    evidence, steps = Evidence(slippery_grid(), Hypotheses(axes)), _steps()
    first = [_milliseconds(partial(_take_in, evidence, *step)) for step in steps]
    again = [_milliseconds(partial(_take_in, evidence, *step)) for step in steps[-30:]]
    return {
        f"{name}_ms": statistics.median(first),
        f"{name}_ms_p95": float(np.quantile(first, 0.95)),
        f"{name}_ms_again": statistics.median(again),
    }


def _take_in(evidence: Evidence, state: Ints, action: str, target: Ints) -> None:
    evidence.enabled(state, ["north", "south", "west", "east", "load"])
    evidence.step(state, action, target)
    evidence.reward("earned", state, action, target, -0.5, NOISES)


def _steps() -> list[tuple[Ints, str, Ints]]:
    """Moves from different places, with power left."""
    generator = np.random.default_rng(0)
    places = generator.choice((SIDE - 2) ** 2, STEPS, replace=False)
    steps = []
    for place in places.tolist():
        row, col, power = 1 + place // (SIDE - 2), 1 + place % (SIDE - 2), int(generator.integers(1, 6))
        states = np.array([row, col, power]), np.array([row, col + 1, power - 1])
        steps.append((states[0], "east", states[1]))
    return steps


def _environment(count: int) -> dict[str, Sequence[Fraction]]:
    """A rock at each of so many places, with one of seven odds to slip."""
    return {
        "rock_row": [Fraction(place // SIDE % SIDE) for place in range(count)],
        "rock_col": [Fraction(place % SIDE) for place in range(count)],
        "slip": [Fraction(place % 7, 20) for place in range(count)],
    }


def _capability(count: int) -> dict[str, Sequence[Fraction]]:
    """How fast power drains, and how much a move needs."""
    return {
        "drain": [Fraction(place % 50 + 1, 51) for place in range(count)],
        "need": [Fraction(place % 3) for place in range(count)],
    }


def slippery_grid(side: int = SIDE) -> Program:
    """A robot on a grid slips to either side unless there is the rock, and its battery drains."""
    rock = "rock_row = {row} & rock_col = {col}"
    moves, drains = [], []
    for action, (variable, value) in MOVES.items():
        ahead = rock.format(**{"row": "row", "col": "col", variable: value})
        low, high = f"max({variable} - 1, 0)", f"min({variable} + 1, {side - 1})"
        aside = "col" if variable == "row" else "row"
        outcomes = (
            _outcome(f"{ahead} ? 0 : 1 - slip", variable, low if value.endswith("- 1") else high),
            _outcome("slip / 2", aside, f"max({aside} - 1, 0)"),
            _outcome("slip / 2", aside, f"min({aside} + 1, {side - 1})"),
            Update(parse(f"{ahead} ? 1 - slip : 0"), {}),
        )
        moves.append(Command(action, parse(f"!({rock.format(row='row', col='col')})"), (outcomes,), action))
        drain = (_outcome("drain", "power", "power - 1"), Update(parse("1 - drain"), {}))
        drains.append(Command(action, parse("power > 0 & power >= need"), (drain,), action))
    drains.append(Command("load", parse("true"), ((_outcome("1", "power", "5"),),), "load"))
    one = parse("1")
    walk = Process(
        "walk",
        "environment",
        (integer("row", 0, side - 1), integer("col", 0, side - 1)),
        tuple(moves),
        (InitialValues(one, {"row": parse("0"), "col": parse("0")}),),
    )
    battery = Process(
        "battery",
        "capability",
        (integer("power", 0, 5),),
        tuple(drains),
        (InitialValues(one, {"power": parse("5")}),),
    )
    rules = (RewardItem(parse("-1 / 2")), RewardItem(parse("need / 10"), parse("power' < power")))
    return Program("slippery grid", (walk, battery), {}, {"earned": RewardStructure(rules)})


def _outcome(probability: str, variable: str, value: str) -> Update:
    return Update(parse(probability), {variable: parse(value)})


def _milliseconds(run: Callable[[], None]) -> float:
    begin = time.perf_counter()
    run()
    return 1000 * (time.perf_counter() - begin)
