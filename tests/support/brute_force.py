"""Properties of small MDPs in fractions, by trying all policies: slow, plain, and without an engine.

Formulas are nested tuples, as ("P", "max", ">=", Fraction(1, 2), ("F", ("label", "a"))).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from operator import ge, gt, le, lt
from typing import Any, TypeAlias

Formula: TypeAlias = tuple[Any, ...]
States: TypeAlias = frozenset[int]
INFINITE = None  # a value; larger than every number
COMPARE: dict[str, Callable[[Any, Any], bool]] = {">=": ge, ">": gt, "<=": le, "<": lt}


@dataclass(frozen=True)
class SmallMDP:
    """An MDP that is small enough to try every policy.

    Attributes:
        choices: for each state its choices, each a mapping successor -> probability.
        rewards: reward structure -> for each state the reward of each choice.
        labels: name -> states.
    """

    choices: tuple[tuple[dict[int, Fraction], ...], ...]
    rewards: dict[str, tuple[tuple[Fraction, ...], ...]]
    labels: dict[str, States]

    def prism(self) -> str:
        """Return the model in PRISM's language; the first state is initial."""
        lines = ["mdp", "module m", f"  s : [0..{len(self.choices) - 1}] init 0;"]
        for state, choices in enumerate(self.choices):
            for action, successors in enumerate(choices):
                updates = " + ".join(
                    f"{p.numerator}/{p.denominator} : (s'={to})" for to, p in successors.items()
                )
                lines.append(f"  [a{action}] s={state} -> {updates};")
        lines.append("endmodule")
        for name, states in self.labels.items():
            lines.append(
                f'label "{name}" = {" | ".join(f"s={state}" for state in sorted(states)) or "false"};'
            )
        for name, rewards in self.rewards.items():
            lines.append(f'rewards "{name}"')
            lines += [
                f"  [a{action}] s={state} : {value.numerator}/{value.denominator};"
                for state, values in enumerate(rewards)
                for action, value in enumerate(values)
            ]
            lines.append("endrewards")
        return "\n".join(lines) + "\n"


def text_of(formula: Formula) -> str:
    """Return a formula as PRISM writes it."""
    match formula:
        case ("label", name):
            return f'"{name}"'
        case ("not", inner):
            return f"!({text_of(inner)})"
        case ("and" | "or" as joint, left, right):
            return f"({text_of(left)}) {'&' if joint == 'and' else '|'} ({text_of(right)})"
        case ("P", direction, compare, bound, path):
            return f"P{direction}{compare}{bound.numerator}/{bound.denominator} [{_path_text(path)}]"
        case ("R", structure, direction, compare, bound, path):
            operator = f'R{{"{structure}"}}{direction}{compare}{bound.numerator}/{bound.denominator}'
            return f"{operator} [{_path_text(path)}]"
    raise AssertionError(formula)


def _path_text(path: Formula) -> str:
    match path:
        case ("X" | "F" | "G" as kind, inner):
            return f"{kind} ({text_of(inner)})"
        case ("F<=" | "F>=" | "G<=" | "G>=" as kind, steps, inner):
            return f"{kind}{steps} ({text_of(inner)})"
        case ("U" | "W" | "R" as kind, left, right):
            return f"({text_of(left)}) {kind} ({text_of(right)})"
        case ("U>=", steps, left, right):
            return f"({text_of(left)}) U>={steps} ({text_of(right)})"
        case ("U[]", least, most, left, right):
            return f"({text_of(left)}) U[{least},{most}] ({text_of(right)})"
        case ("C<=", steps):
            return f"C<={steps}"
    raise AssertionError(path)


def satisfying(mdp: SmallMDP, formula: Formula) -> States:
    """Return the states in which a formula holds."""
    everywhere = frozenset(range(len(mdp.choices)))
    match formula:
        case ("label", name):
            return mdp.labels[name]
        case ("not", inner):
            return everywhere - satisfying(mdp, inner)
        case ("and", left, right):
            return satisfying(mdp, left) & satisfying(mdp, right)
        case ("or", left, right):
            return satisfying(mdp, left) | satisfying(mdp, right)
    compare, bound = formula[-3], formula[-2]
    return frozenset(
        state
        for state, value in enumerate(values(mdp, formula))
        if (compare in (">=", ">") if value is INFINITE else COMPARE[compare](value, bound))
    )


def values(mdp: SmallMDP, formula: Formula) -> list[Fraction | None]:
    """Return the value of the operator at the root of a formula in every state; None is infinite."""
    direction = formula[-4] or ("min" if formula[-3] in (">=", ">") else "max")
    best = max if direction == "max" else min
    if formula[0] == "P":
        return list(_probabilities(mdp, formula[-1], best))
    rewards = mdp.rewards[formula[1]]
    match formula[-1]:
        case ("C<=", steps):
            return list(_step(mdp, best, steps, [Fraction(0)] * len(mdp.choices), rewards=rewards))
        case ("F", inner):
            return _reward_until(mdp, satisfying(mdp, inner), rewards, best)
    raise AssertionError(formula)


def _probabilities(mdp: SmallMDP, path: Formula, best: Any) -> Sequence[Fraction]:
    everywhere = frozenset(range(len(mdp.choices)))
    match path:
        case ("X", inner):
            return _step(mdp, best, 1, _indicator(mdp, satisfying(mdp, inner)))
        case ("F<=", steps, inner):
            goal = satisfying(mdp, inner)
            return _step(mdp, best, steps, _indicator(mdp, goal), fixed=goal)
        case ("F", inner):
            return _until(mdp, everywhere, satisfying(mdp, inner), best)
        case ("U", left, right):
            return _until(mdp, satisfying(mdp, left), satisfying(mdp, right), best)
        case ("G", inner):
            opposite = min if best is max else max
            leaves = _until(mdp, everywhere, everywhere - satisfying(mdp, inner), opposite)
            return [1 - value for value in leaves]
    return _rewritten(mdp, path, best)


def _rewritten(mdp: SmallMDP, path: Formula, best: Any) -> Sequence[Fraction]:
    match path:
        case ("G<=", steps, inner):
            stay = satisfying(mdp, inner)
            return _within(mdp, best, steps, stay, _indicator(mdp, stay))
        case ("W", left, right):
            return _weak_until(mdp, satisfying(mdp, left), satisfying(mdp, right), best)
        case ("R", left, right):
            held = satisfying(mdp, right)
            return _weak_until(mdp, held, held & satisfying(mdp, left), best)
    return _later(mdp, path, best)


def _later(mdp: SmallMDP, path: Formula, best: Any) -> Sequence[Fraction]:
    everywhere = frozenset(range(len(mdp.choices)))
    match path:
        case ("F>=" | "G>=" as kind, steps, inner):
            return _within(mdp, best, steps, everywhere, list(_probabilities(mdp, (kind[0], inner), best)))
        case ("U>=", steps, left, right):
            then = list(_probabilities(mdp, ("U", left, right), best))
            return _within(mdp, best, steps, satisfying(mdp, left), then)
        case ("U[]", least, most, left, right):
            stay, goal = satisfying(mdp, left), satisfying(mdp, right)
            then = _indicator(mdp, goal)
            for _ in range(most - least):
                again = _within(mdp, best, 1, stay - goal, then)
                then = [Fraction(1) if state in goal else again[state] for state in everywhere]
            return _within(mdp, best, least, stay, then)
    raise AssertionError(path)


def _within(mdp: SmallMDP, best: Any, steps: int, stay: States, found: list[Fraction]) -> list[Fraction]:
    """Take so many steps, each from a state to stay in; 0 elsewhere."""
    for _ in range(steps):
        moved = _step(mdp, best, 1, found)
        found = [moved[state] if state in stay else Fraction(0) for state in range(len(mdp.choices))]
    return found


def _weak_until(mdp: SmallMDP, left: States, right: States, best: Any) -> list[Fraction]:
    """Return the best probability to reach `right` through `left`, or to stay in `left` for ever."""
    everywhere = frozenset(range(len(mdp.choices)))
    columns = []
    for policy in _policies(mdp):
        chain = _chain(mdp, policy)
        reached = _reaching(chain, left, right)
        left_behind = _reaching(chain, everywhere, everywhere - (left - right))
        columns.append([one + 1 - other for one, other in zip(reached, left_behind, strict=True)])
    return [best(column) for column in zip(*columns, strict=True)]


def _indicator(mdp: SmallMDP, states: States) -> list[Fraction]:
    return [Fraction(state in states) for state in range(len(mdp.choices))]


def _step(
    mdp: SmallMDP,
    best: Any,
    steps: int,
    found: list[Fraction],
    *,
    fixed: States = frozenset(),
    rewards: Any = None,
) -> list[Fraction]:
    """Backward induction over so many steps."""
    for _ in range(steps):
        found = [
            found[state]
            if state in fixed
            else best(
                sum(
                    (p * found[to] for to, p in successors.items()),
                    rewards[state][action] if rewards else Fraction(0),
                )
                for action, successors in enumerate(choices)
            )
            for state, choices in enumerate(mdp.choices)
        ]
    return found


def _policies(mdp: SmallMDP) -> Iterator[tuple[int, ...]]:
    yield from product(*(range(len(choices)) for choices in mdp.choices))


def _until(mdp: SmallMDP, allowed: States, goal: States, best: Any) -> list[Fraction]:
    """Return the best probability of an until; one policy is best in all states, so each stands alone."""
    found = [_reaching(_chain(mdp, policy), allowed, goal) for policy in _policies(mdp)]
    return [best(column) for column in zip(*found, strict=True)]


def _reward_until(mdp: SmallMDP, goal: States, rewards: Any, best: Any) -> list[Fraction | None]:
    """Return the best expected sum of rewards until the goal; infinite where it may not be reached."""
    everywhere = frozenset(range(len(mdp.choices)))
    columns: list[list[Fraction | None]] = [[] for _ in mdp.choices]
    for policy in _policies(mdp):
        chain = _chain(mdp, policy)
        sure = frozenset(s for s, p in enumerate(_reaching(chain, everywhere, goal)) if p == 1)
        earned = [rewards[state][action] for state, action in enumerate(policy)]
        sums = _solve(chain, sure - goal, [Fraction(0) if s in goal else earned[s] for s in everywhere])
        for state in everywhere:
            columns[state].append(sums[state] if state in sure else INFINITE)
    return [_best_of(column, best) for column in columns]


def _best_of(column: list[Fraction | None], best: Any) -> Fraction | None:
    finite = [value for value in column if value is not INFINITE]
    if not finite or (best is max and len(finite) < len(column)):
        return INFINITE
    return best(finite)  # type: ignore[no-any-return]


def _chain(mdp: SmallMDP, policy: tuple[int, ...]) -> list[dict[int, Fraction]]:
    return [mdp.choices[state][action] for state, action in enumerate(policy)]


def _reaching(chain: list[dict[int, Fraction]], allowed: States, goal: States) -> list[Fraction]:
    """Return the probability of an until in a chain."""
    leading = set(goal)
    while more := {s for s in allowed if s not in leading and any(to in leading for to in chain[s])}:
        leading |= more
    return _solve(chain, frozenset(leading) - goal, [Fraction(s in goal) for s in range(len(chain))])


def _solve(chain: list[dict[int, Fraction]], unknown: States, constant: list[Fraction]) -> list[Fraction]:
    """Solve x = constant + chain x in the unknown states by elimination; elsewhere x = constant."""
    rows: dict[int, tuple[dict[int, Fraction], Fraction]] = {}
    for state in unknown:
        inside = {to: p for to, p in chain[state].items() if to in unknown}
        known = sum(p * constant[to] for to, p in chain[state].items() if to not in unknown)
        rows[state] = inside, known + constant[state]
    found = list(constant)
    order = sorted(unknown)
    for state in order:
        row, rest = rows[state]
        scale = 1 / (1 - row.pop(state, Fraction(0)))
        rows[state] = row, rest = {to: p * scale for to, p in row.items()}, rest * scale
        for other in order:
            factor = rows[other][0].pop(state, Fraction(0)) if other != state else Fraction(0)
            if factor:
                theirs, amount = rows[other]
                for to, p in row.items():
                    theirs[to] = theirs.get(to, Fraction(0)) + factor * p
                rows[other] = theirs, amount + factor * rest
    for state in order:
        found[state] = Fraction(rows[state][1])
    return found
