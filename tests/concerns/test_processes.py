"""Declared processes: composed, explored and built by Storm, against plain Python and hand-made values."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from merap.belief.steps import holds_in_states
from merap.checker.combination_model import build_combination
from merap.checker.storm import build_text
from merap.concerns.combination import Condition, DeclaredCombination, RewardRule
from merap.concerns.composition import compose
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.processes import Change, DeclaredProcess, moved
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.comparison import compare
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum
from merap.prism.rendering import render
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.program.expressions import TRUE, Constant, parse
from merap.program.form import ConcernName, InitialValues, Update, integer
from tests.support.declared_processes import enabled, successors
from tests.support.hand_made import at, graph_combination, number, parsed, with_capability, with_objective
from tests.support.programs import outcome, start


def change(where: str, *outcomes: Update, actions: str = "") -> Change:
    return Change(frozenset(actions.split()) or None, parse(where), outcomes)


def process(
    name: str, concern: ConcernName, bounds: tuple[int, int], first: str, *changes: Change
) -> DeclaredProcess:
    return DeclaredProcess(name, concern, (integer(name, *bounds),), start(**{name: first}), changes)


def explored(combination: DeclaredCombination) -> TabularMDP:
    program = compose(combination)
    return tabular(program, explore(program), reward="objective")


def require_agreement(combination: DeclaredCombination) -> None:
    """Storm builds of the text what is explored, and both what the definition says."""
    mdp = explored(combination)
    compare(build_text(render(combination), combination.name).mdp(), mdp).require_same()
    names = mdp.variable_names
    states: list[dict[str, Any]] = [dict(zip(names, row, strict=True)) for row in mdp.valuations.tolist()]
    complete = mdp.labels["done"]
    for number_, state in enumerate(states):
        found: dict[str, dict[tuple[Any, ...], float]] = {}
        for choice in range(*mdp.state_to_choice[number_ : number_ + 2]):
            branches = range(*mdp.choice_to_branch[choice : choice + 2])
            found[mdp.action_names[mdp.choice_action[choice]]] = {
                tuple(states[mdp.branch_target[one]][name] for name in names if name != "done"): float(
                    mdp.branch_prob[one]
                )
                for one in branches
            }
        if complete[number_]:
            assert list(found) == ["end"]
            continue
        assert set(found) == set(enabled(combination, state))
        for action, branches_ in found.items():
            expected: dict[tuple[Any, ...], Fraction] = defaultdict(Fraction)
            for chance, after in successors(combination, state, action):
                expected[tuple({**state, **after}[name] for name in names if name != "done")] += chance
            assert branches_ == pytest.approx({key: float(value) for key, value in expected.items() if value})


LIT = process(
    "lit", "environment", (0, 1), "0", change("true", outcome("0.3", lit="1"), outcome("0.7", lit="0"))
)
CHARGE = process(
    "charge",
    "capability",
    (0, 4),
    "4",
    change("true", outcome("1", charge="4"), actions="stop"),
    change("ice & charge > 0", outcome("0.5", charge="charge - 1"), outcome("0.5")),
    change("charge > 0", outcome("1 / (charge + 1)", charge="charge - 1"), outcome("charge / (charge + 1)")),
)


def with_processes(combination: DeclaredCombination, *processes: DeclaredProcess) -> DeclaredCombination:
    def of(concern: ConcernName) -> tuple[DeclaredProcess, ...]:
        return tuple(one for one in processes if one.concern == concern)

    return replace(
        combination,
        environment=replace(combination.environment, processes=of("environment")),
        capability=replace(combination.capability, processes=of("capability")),
        objective=replace(combination.objective, processes=of("objective")),
    )


def two_starts(*processes: DeclaredProcess, requires: str = "true") -> DeclaredCombination:
    graph = graph_combination()
    external = tuple(
        replace(action, requires=parsed(requires)) if action.name == "go" else action
        for action in graph.capability.external
    )
    at_s = np.array([1.0, 0, 0, 0])
    graph = with_objective(with_capability(graph, external=external), start=at_s)
    return with_processes(graph, *processes)


def test_processes_change_by_their_first_match() -> None:
    require_agreement(two_starts(LIT, CHARGE))


def test_an_action_is_disabled_where_it_lacks_what_it_requires() -> None:
    combination = two_starts(LIT, CHARGE, requires="charge > 1 | lit = 1")
    require_agreement(combination)
    mdp = explored(combination)
    charge = mdp.valuations[:, mdp.variable_names.index("charge")]
    lit = mdp.valuations[:, mdp.variable_names.index("lit")]
    mode = mdp.valuations[:, mdp.variable_names.index("mode")]
    going = ~mdp.labels["done"] & (mode != 1)
    goes = mdp.enabled[:, mdp.action_names.index("go")]
    assert np.array_equal(goes[going], ((charge > 1) | (lit == 1))[going])


def test_what_reads_where_the_step_leads_is_drawn_with_it() -> None:
    used = process(
        "used", "capability", (0, 3), "3",
        change("used = 0", outcome("1")),
        Change(None, moved(["loc"]), (outcome("0.5", used="used - 1"), outcome("0.5"))),
    )  # fmt: skip
    seen = process(
        "seen", "objective", (0, 1), "0", change("used' < used & lit' = 1", outcome("1", seen="1"))
    )
    combination = two_starts(LIT, used, seen)
    assert [one.name for one in compose(combination).processes] == ["capability", "seen", "objective"]
    require_agreement(combination)


def test_attributes_of_the_place_that_a_step_leads_to() -> None:
    wet = process("wet", "environment", (0, 1), "0", change("ice'", outcome("0.9", wet="1"), outcome("0.1")))
    require_agreement(two_starts(wet))


def test_rewards_and_ends_read_processes() -> None:
    rules = (
        RewardRule(Condition(where=parsed("charge' < charge")), parsed("-charge' - lit")),
        RewardRule(Condition(), number(1)),
    )
    combination = with_objective(
        two_starts(LIT, CHARGE),
        rules=rules,
        ends_in=parsed("charge = 0"),
        unsafe=parsed("charge < 2"),
    )
    require_agreement(combination)
    mdp = explored(combination)
    assert mdp.labels["unsafe"].any()


def test_arrays_over_locations_and_modes_refuse_processes() -> None:
    for combination in (two_starts(LIT), two_starts(requires="mode = 0")):
        with pytest.raises(InputError, match="know nothing but locations and modes so far"):
            holds_in_states(combination, TRUE)


def test_several_initial_values_have_their_weights() -> None:
    starts = (
        InitialValues(Constant(Fraction(1, 4)), {"lit": parse("1")}),
        InitialValues(Constant(Fraction(3, 4)), {"lit": parse("0")}),
    )
    combination = two_starts(replace(LIT, initial=starts))
    built = build_combination(combination).mdp
    compare(built, explored(combination)).require_same()
    assert sorted(built.initial[built.initial > 0].tolist()) == [0.25, 0.75]


# --- a web service: values by PRISM text written by hand, on which Storm and PRISM-games agree ---


def web_service(up: str, down: str, boot: str, w_time: str) -> DeclaredCombination:
    graph = graph_combination()
    one_place = Space(("here",), np.zeros((1, 2)), (), np.zeros((1, 0), dtype=np.int64), None, (), ())
    load = process(
        "load", "environment", (0, 4), "1",
        change(
            "true",
            outcome(up, load="min(load + 1, 4)"),
            outcome(down, load="max(load - 1, 0)"),
            outcome(f"1 - {up} - {down}"),
        ),
    )  # fmt: skip
    servers = DeclaredProcess(
        "servers",
        "capability",
        (integer("running", 1, 4), integer("booting", 0, 1)),
        start(running="1", booting="0"),
        (
            change("true", outcome("1", booting="1"), actions="grow"),
            change("true", outcome("1", running="running - 1"), actions="shrink"),
            change("booting = 1", outcome(boot, running="running + 1", booting="0"), outcome(f"1 - {boot}")),
        ),
    )
    stay = (Outcome(None, number(1)),)
    external = (
        ExternalAction("keep", stay, "stay"),
        ExternalAction("grow", stay, "stay", parse("booting = 0 & running < 4")),
        ExternalAction("shrink", stay, "stay", parse("running > 1")),
    )
    value = parse(f"-{w_time} * max(load - running, 0) - running")
    free = np.zeros(1, dtype=np.bool_)
    combination = replace(
        graph,
        space=one_place,
        modes=("ready",),
        actions=("keep", "grow", "shrink"),
        environment=replace(
            graph.environment, blocked=free, blocked_edges=np.zeros((1, 0), dtype=np.bool_), attributes=()
        ),
        capability=replace(graph.capability, no_entry=free, external=external, innate=None),
        objective=replace(
            graph.objective, start=np.ones(1), goal=at(free),
            rules=(RewardRule(Condition(), value),),
            ends_in=None, ends_after=None, unsafe=None,
        ),
    )  # fmt: skip
    return with_processes(combination, load, servers)


@pytest.mark.parametrize(
    ("settings", "best"),
    [(("0.5", "0.1", "0.9", "4"), -114.531431), (("0.1", "0.3", "0.3", "1"), -34.425167)],
)
def test_the_best_return_of_a_web_service(settings: tuple[str, str, str, str], best: float) -> None:
    combination = web_service(*settings)
    assert optimum(explored(combination), horizon=30) == pytest.approx(best, abs=1e-6)
    require_agreement(combination)
