"""Small combinations drawn from a seed, with every feature of composition.

Each is valid: distributions sum to one and every state that is not complete has an action
(`wait` in terminal modes, `proceed` in the others).
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TypeVar

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
from merap.concerns.location_tables import mode_in
from merap.concerns.space import Attribute, Space
from merap.mdp.model import Bools, Floats
from merap.program.expressions import TRUE, Constant, Expression, all_of
from tests.support.hand_made import at, grid_space, number, parsed

Generator = np.random.Generator
Kind = TypeVar("Kind")

# Truth values over attributes `ice` (bool), `light` (int), `slope` (real) and the mode.
TRUTHS = (
    "ice",
    "light >= 2",
    "!ice & light != 1",
    "slope < 0.25",
    "ice => light > 1",
    "ice <=> light > 1",
    "mode = 0",
    "mod(light, 2) = 1 | slope > 1",
    "true",
    "false",
)
PRIMED_TRUTHS = ("ice'", "light' > light", "slope' <= slope", "ice != ice'", "light' = 0 | ice")
# Pairs of a probability and its complement, which may be 0 or 1 in places.
PROBABILITIES = (
    ("0.5", "0.5"),
    ("1", "0"),
    ("0", "1"),
    ("{t} ? 0.6 : 0.9", "1 - ({t} ? 0.6 : 0.9)"),
    ("{t} ? 1 : 0.25", "1 - ({t} ? 1 : 0.25)"),
    ("{t} ? 0 : 1", "{t} ? 1 : 0"),
    ("0.4 + 0.2 * light", "1 - (0.4 + 0.2 * light)"),
    ("0.1 + 0.3 * light", "1 - 0.1 - 0.3 * light"),
    ("1 / (1 + light)", "light / (light + 1)"),
    ("min(1, max(0, slope))", "1 - min(1, max(0, slope))"),
    ("0.1234567891", "0.8765432109"),
)
VALUES = (
    "3",
    "-1",
    "-0.5",
    "light - light'",
    "slope' * 2 - 1",
    "-(ice ? 0.3 : 0.7) * light",
    "mode - 2 * mode'",
    "floor(slope) + mod(light - 3, 2)",
)


def random_combination(seed: int) -> DeclaredCombination:
    """Return the combination of a seed; names are `e<seed>.c.o`."""
    generator = np.random.default_rng(seed)
    space = _grid(generator) if generator.random() < 0.4 else _graph(generator)
    start = _start(generator, space)
    mode_count = int(generator.integers(1, 5))
    innate = _innate(generator, mode_count) if generator.random() < 0.7 else None
    external = _external(generator, space)
    extra = ("proceed", "reset", "start_automaton")
    draft = DeclaredCombination(
        name=f"e{seed}.c.o",
        space=space,
        modes=tuple(f"m{mode}" for mode in range(mode_count)),
        actions=(*(action.name for action in external), "unused", *extra),
        environment=_environment(generator, space, start),
        capability=Capability(
            "c", {}, _mask(generator, space.num_locations, 0.1) & (start == 0), external, innate
        ),
        objective=DeclaredObjective(
            name="o",
            parameters={},
            start=start,
            horizon=int(generator.integers(1, 13)),
            goal=at(_mask(generator, space.num_locations, 0.4)),
            rules=(),
            ends_after=None,
            ends_in=None,
            unsafe=None,
        ),
        discount=float(generator.choice([0.5, 0.9, 0.95, 1.0])),
        digest="0" * 64,
    )
    return replace(draft, objective=_objective(generator, draft))


def _mask(generator: Generator, size: int, share: float) -> Bools:
    return np.asarray(generator.random(size) < share)


def _grid(generator: Generator) -> Space:
    rows, columns = generator.choice([1, 3, 4, 5], size=2).tolist()
    return replace(grid_space((rows, columns)), attributes=_attributes(generator, rows * columns))


def _graph(generator: Generator) -> Space:
    size, labels = int(generator.choice([1, 2, 6, 9, 12])), int(generator.integers(2, 5))
    target = generator.integers(0, size, size=(size, labels))
    target[generator.random((size, labels)) < 0.2] = -1
    return Space(
        locations=tuple(f"place{index}" for index in range(size)),
        positions=np.zeros((size, 2)),
        moves=("far_east", "east", "north", "up")[:labels],
        target=target,
        shape=None,
        attributes=_attributes(generator, size),
        detectors=(),
    )


def _attributes(generator: Generator, size: int) -> tuple[Attribute, ...]:
    return (
        Attribute("ice", "bool", 0, 1, _mask(generator, size, 0.4).astype(np.float64)),
        Attribute("light", "int", 0, 3, generator.integers(0, 4, size=size).astype(np.float64)),
        Attribute("slope", "real", -2, 2, generator.choice([-1.5, 0.0, 0.1, 0.25, 1.0, 1.75], size=size)),
        # With the labels `far_east` and `east` these two make one name, were it not told apart.
        Attribute("ice_far", "bool", 0, 1, _mask(generator, size, 0.4).astype(np.float64)),
    )


def _environment(generator: Generator, space: Space, start: Floats) -> Environment:
    free = generator.random() < 0.3
    return Environment(
        "e",
        {},
        blocked=_mask(generator, space.num_locations, 0 if free else 0.15) & (start == 0),
        blocked_edges=np.asarray(generator.random(space.target.shape) < (0 if free else 0.1)),
        attributes=space.attributes,
    )


def _start(generator: Generator, space: Space) -> Floats:
    count = int(generator.integers(1, min(4, space.num_locations + 1)))
    start = np.zeros(space.num_locations)
    start[generator.choice(space.num_locations, count, replace=False)] = generator.integers(1, 4, size=count)
    start /= start.sum()
    return start


def _truth(generator: Generator, *, primed: bool) -> str:
    return str(generator.choice([*TRUTHS, *(PRIMED_TRUTHS if primed else ()), "ice_far", "slope = 0.1"]))


def _external(generator: Generator, space: Space) -> tuple[ExternalAction, ...]:
    actions = [
        _action(generator, f"act{index}", len(space.moves)) for index in range(int(generator.integers(2, 6)))
    ]
    return (ExternalAction("wait", (Outcome(None, number(1)),), "stay"), *actions)


def _action(generator: Generator, name: str, labels: int) -> ExternalAction:
    """Two or three outcomes; of three, the first pair's complement is shared by halves."""
    moves: list[int | None] = [*generator.integers(0, labels, size=3).tolist()]
    if generator.random() < 0.5:
        moves[int(generator.integers(3))] = None
    first, rest = PROBABILITIES[int(generator.integers(len(PROBABILITIES)))]
    truth = f"({_truth(generator, primed=True)})"
    texts = [first.format(t=truth), rest.format(t=truth)]
    if generator.random() < 0.4:
        texts = [texts[0], f"({texts[1]}) / 2", f"({texts[1]}) * 0.5"]
    outcomes = tuple(Outcome(move, parsed(text)) for move, text in zip(moves, texts, strict=False))
    return ExternalAction(name, outcomes, "disable" if generator.random() < 0.3 else "stay")


def _innate(generator: Generator, mode_count: int) -> Innate:
    terminal = frozenset(np.flatnonzero(_mask(generator, mode_count, 0.6)).tolist()) or frozenset({0})
    proceed = {
        mode: _row(generator, mode_count)
        for mode in range(mode_count)
        if mode not in terminal or generator.random() < 0.4
    }
    reset = {mode: {0: number(1)} for mode in range(mode_count) if generator.random() < 0.4}
    return Innate(
        name="automaton",
        entry=int(generator.integers(mode_count)),
        initial=int(generator.integers(mode_count)),
        terminal=terminal,
        restart=bool(generator.random() < 0.5),
        actions=(InnateAction("proceed", proceed), InnateAction("reset", reset)),
    )


def _row(generator: Generator, mode_count: int) -> dict[int, Expression]:
    shares = generator.integers(0, 4, size=mode_count).tolist()
    if not any(shares):
        shares[0] = 1
    return {mode: Constant(Fraction(share, sum(shares))) for mode, share in enumerate(shares)}


def _objective(generator: Generator, draft: DeclaredCombination) -> DeclaredObjective:
    rules = [_rule(generator, draft) for _ in range(int(generator.integers(0, 5)))]
    return replace(
        draft.objective,
        rules=tuple(rules),
        ends_after=_maybe(
            generator, Condition(_actions(generator, draft), all_of(_states(generator, draft)))
        ),
        ends_in=_maybe(
            generator,
            all_of([at(_mask(generator, draft.space.num_locations, 0.15)), *_states(generator, draft)]),
        ),
        unsafe=_maybe(generator, all_of(_states(generator, draft))),
    )


def _maybe(generator: Generator, value: Kind) -> Kind | None:
    return value if generator.random() < 0.6 else None


def _rule(generator: Generator, draft: DeclaredCombination) -> RewardRule:
    terms = [
        *_states(generator, draft),
        *_states(generator, draft, "'"),
        _maybe(generator, _where(generator, primed=True)) or TRUE,
    ]
    return RewardRule(
        Condition(_actions(generator, draft), all_of(terms)), parsed(str(generator.choice(VALUES)))
    )


def _actions(generator: Generator, draft: DeclaredCombination) -> frozenset[str] | None:
    return _maybe(generator, frozenset(generator.choice(draft.actions, size=3).tolist()))


def _states(generator: Generator, draft: DeclaredCombination, prime: str = "") -> list[Expression]:
    """Conditions on location, mode and attributes, or on location and mode of the successor."""
    modes = np.flatnonzero(_mask(generator, len(draft.modes), 0.7)).tolist()
    terms = [
        at(_mask(generator, draft.space.num_locations, 0.6), prime),
        mode_in(modes, len(draft.modes), f"mode{prime}"),
        *([] if prime else [_where(generator, primed=False)]),
    ]
    return [term for term in terms if generator.random() < 0.6]


def _where(generator: Generator, *, primed: bool) -> Expression:
    return parsed(_truth(generator, primed=primed))
