"""Programs for tests: small ones by hand, and random ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from merap.program.expressions import (
    TRUE,
    Column,
    Constant,
    Expression,
    Levels,
    Lookup,
    Operation,
    Table,
    Variable,
    parse,
)
from merap.program.form import (
    Command,
    Draw,
    InitialValues,
    Process,
    Program,
    RewardItem,
    RewardStructure,
    Update,
    boolean,
    integer,
)


def outcome(probability: str, **assignments: str) -> Update:
    return Update(parse(probability), {name: parse(value) for name, value in assignments.items()})


def command(action: str | None, guard: str, *draws: Sequence[Update]) -> Command:
    place = f"[{action or ''}] {guard}"
    return Command(action, parse(guard), tuple(tuple(draw) for draw in draws), place)


def start(**values: str) -> tuple[InitialValues, ...]:
    return (InitialValues(Constant(Fraction(1)), {name: parse(value) for name, value in values.items()}),)


# --- random programs ---

DECIMALS = [Fraction(1, 10), Fraction(3, 10), Fraction(1, 3), Fraction(9, 10), Fraction(1, 2), Fraction(2)]
Domains = dict[str, tuple[int, int] | None]
VARIABLES: dict[str, Domains] = {"p": {"x": (-1, 3), "b": None}, "q": {"y": (0, 4), "z": (2, 3)}}


PRICES = Table(
    "price", Column(Levels((Fraction(1, 10), Fraction(3), Fraction(-2))), np.array([0, 1, 2, 1, 1, 0, 2, 2]))
)
UNLOCKED = Table("open", Column(Levels((False, True)), np.array([1, 0, 0, 1, 1, 0])))


def looked_up(table: Table, name: str) -> Expression:
    return Lookup(table, Operation("+", (Variable(name, 0), Constant(Fraction(1)))))


def _numbers(names: Sequence[str], depth: int) -> st.SearchStrategy[Expression]:
    leaf = st.sampled_from(
        [*(Constant(value) for value in DECIMALS), *(Constant(Fraction(n)) for n in range(-1, 4))]
        + [Variable(name, 0) for name in names] * 2
        + [looked_up(PRICES, name) for name in names]
    )
    if depth == 0:
        return leaf
    inner = _numbers(names, depth - 1)
    two = st.tuples(inner, inner)
    return st.one_of(
        leaf,
        st.builds(Operation, st.sampled_from(["+", "-", "*", "min", "max", "mod", "/"]), two),
        st.builds(lambda one: Operation("neg", (one,)), inner),
        st.builds(lambda one: Operation("floor", (one,)), inner),
        st.builds(lambda one: Lookup(PRICES, one), inner),
    )


def _truths(numbers: Sequence[str], truths: Sequence[str], depth: int) -> st.SearchStrategy[Expression]:
    number = _numbers(numbers, 2)
    leaf = st.builds(
        Operation, st.sampled_from(["<", "<=", "=", "!=", ">", ">="]), st.tuples(number, number)
    ) | st.sampled_from(
        [*(Variable(name, 0) for name in truths), *(looked_up(UNLOCKED, name) for name in numbers)]
    )
    if depth == 0:
        return leaf
    inner = _truths(numbers, truths, depth - 1)
    return st.one_of(
        leaf,
        st.builds(Operation, st.sampled_from(["&", "|", "=>"]), st.tuples(inner, inner)),
        st.builds(lambda one: Operation("!", (one,)), inner),
    )


@dataclass(frozen=True)
class Names:
    """What random expressions may read."""

    numbers: Sequence[str]
    truths: Sequence[str]

    def number(self, depth: int) -> st.SearchStrategy[Expression]:
        return _numbers(self.numbers, depth)

    def truth(self, depth: int) -> st.SearchStrategy[Expression]:
        return _truths(self.numbers, self.truths, depth)


CLOSED = Names(["x", "y", "z"], ["b"])
OPEN = Names(["x", "y", "z", "u", "k", "u"], ["b", "t"])


@st.composite
def _draws(draw: st.DrawFn, own: Domains, read: Names) -> Draw:
    """Outcomes with a probability that depends on the state, and assignments that stay in their range."""
    condition = draw(read.truth(0))
    parts = draw(st.sampled_from([(1,), (1, 1), (1, 9), (1, 2, 7)]))
    outcomes: list[Update] = []
    for place, part in enumerate(parts):
        chance: Expression = Constant(Fraction(part, sum(parts)))
        if len(parts) == 2:  # p and 1 - p, where p may be 0 or 1
            weight = Operation("?:", (condition, Constant(Fraction(1)), chance))
            chance = (
                weight if place == 0 else Operation("-", (Constant(Fraction(1)), outcomes[0].probability))
            )
        assignments: dict[str, Expression] = {}
        for name, domain in own.items():
            if draw(st.booleans()):
                assignments[name] = draw(_assigned(domain, read))
        outcomes.append(Update(chance, assignments))
    return tuple(outcomes)


@st.composite
def _assigned(draw: st.DrawFn, domain: tuple[int, int] | None, read: Names) -> Expression:
    if domain is None:
        return draw(read.truth(1))
    low, high = (Constant(Fraction(value)) for value in domain)
    value = Operation("floor", (draw(read.number(1)),))
    if draw(st.integers(0, 9)) == 0:  # it may leave its range
        return value
    return Operation("max", (low, Operation("min", (high, value))))


@st.composite
def programs(draw: st.DrawFn, read: Names = CLOSED) -> Program:
    """Two processes that read each other, with shared actions and steps of their own."""
    processes = []
    for name, own in VARIABLES.items():
        commands = []
        for _ in range(draw(st.integers(1, 3))):
            action = draw(st.sampled_from(["a", "b_", None]))
            guard = draw(read.truth(1))
            draws = tuple(draw(st.lists(_draws(own, read), min_size=1, max_size=2)))
            commands.append(Command(action, guard, draws, f"[{action or ''}] in {name}"))
        variables = tuple(
            boolean(one) if domain is None else integer(one, *domain) for one, domain in own.items()
        )
        values = {
            one: Constant(draw(st.booleans()))
            if domain is None
            else Constant(Fraction(draw(st.integers(*domain))))
            for one, domain in own.items()
        }
        starts = (InitialValues(Constant(Fraction(1)), values),)
        processes.append(Process(name, "environment", variables, tuple(commands), starts))
    label = draw(read.truth(1))
    rules = tuple(
        RewardItem(
            draw(read.number(1)),
            draw(read.truth(0)),
            draw(st.sampled_from([frozenset({"a"}), frozenset[str | None]()])),
        )
        for _ in range(draw(st.integers(0, 2)))
    )
    return Program("random", tuple(processes), {"goal": label}, {"r": RewardStructure(rules)})


ONE_COIN = Program(
    "coin",
    (
        Process(
            "coin",
            "environment",
            (integer("x", 0, 3),),
            (
                command("toss", "x < 3", [outcome("0.1", x="x + 1"), outcome("0.9")]),
                command("rest", "x = 3", [outcome("1")]),
            ),
            start(x="0"),
        ),
    ),
    {"goal": parse("0.1 * x <= 0.3 & x > 2")},
    {"steps": RewardStructure((RewardItem(parse("1"), TRUE, frozenset({"toss"})),))},
)


def process_of(**ranges: tuple[int, int]) -> Process:
    """A process that owns integers, begins where they are least and does nothing."""
    own = tuple(integer(name, low, high) for name, (low, high) in ranges.items())
    return Process(
        "p", "environment", own, (), start(**{name: str(low) for name, (low, _) in ranges.items()})
    )
