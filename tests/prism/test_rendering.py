"""PRISM text, built by Storm, against our exploration: two routes to the same model."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.concerns.combination import Combination, Condition, RewardRule
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.innate import Innate, InnateAction
from merap.families.models import explored
from merap.mdp.comparison import compare
from merap.prism.rendering import render
from merap.prism.templates import WIDTH
from tests.support.hand_made import (
    HAND_MADE,
    at,
    cells,
    graph_combination,
    grid_combination,
    grid_space,
    parsed,
    with_capability,
    with_environment,
    with_objective,
)
from tests.support.large_spaces import random_graph, random_grid
from tests.support.paths import FIXTURES, ROOT
from tests.support.random_combinations import random_combination


def require_agreement(combination: Combination) -> None:
    """The two routes agree on the whole text: states, actions, 1e-12, 1e-9, labels, start distribution."""
    built, found = build_combination(combination).mdp, explored(combination)
    compare(built, found).require_same()
    assert set(found.labels) <= set(built.labels)


@pytest.mark.parametrize("name", HAND_MADE)
def test_storm_builds_what_is_explored(name: str) -> None:
    require_agreement(HAND_MADE[name])


@pytest.mark.parametrize("seed", range(64))
def test_storm_builds_what_is_explored_of_random_combinations(seed: int) -> None:
    require_agreement(random_combination(seed))


def test_random_combinations_have_every_feature() -> None:
    drawn = [random_combination(seed) for seed in range(64)]
    objectives = [combination.objective for combination in drawn]
    innate = [combination.capability.innate for combination in drawn]
    external = [action for combination in drawn for action in combination.capability.external]
    assert {combination.space.shape is None for combination in drawn} == {True, False}
    assert {None} < {automaton and automaton.restart for automaton in innate} == {None, True, False}
    assert {int(np.count_nonzero(objective.start)) for objective in objectives} >= {1, 2, 3}
    assert {action.on_blocked for action in external} == {"stay", "disable"}
    assert {len(action.outcomes) for action in external} >= {1, 2, 3}
    for ends in ("ends_in", "ends_after", "unsafe"):
        assert {getattr(objective, ends) is None for objective in objectives} == {True, False}
    assert max(explored(combination).num_states for combination in drawn) > 30


# --- what is easily got wrong ---


def test_several_starts_in_a_single_row_or_column() -> None:
    # a variable of one value has the range [0..1], and `init` must not let it be 1
    for shape in ((1, 5), (5, 1)):
        combination = grid_combination(size=1, goal=(0, 0))
        space = grid_space(shape)
        one_of = np.zeros(5, dtype=np.bool_)
        start = np.array([0.5, 0.5, 0, 0, 0])
        combination = replace(
            combination,
            space=space,
            environment=replace(
                combination.environment, blocked=one_of, blocked_edges=np.zeros((5, 4), dtype=np.bool_)
            ),
            capability=replace(combination.capability, no_entry=one_of),
            objective=replace(
                combination.objective,
                start=start,
                goal=at(one_of),
                rules=(),
                ends_after=Condition(where=at(one_of)),
            ),
        )
        require_agreement(combination)


def test_an_innate_action_that_is_defined_nowhere_never_fires() -> None:
    graph = graph_combination()
    assert isinstance(graph.capability.innate, Innate)
    innate = replace(
        graph.capability.innate, actions=(*graph.capability.innate.actions, InnateAction("nap", {}))
    )
    combination = replace(with_capability(graph, innate=innate), actions=(*graph.actions, "nap"))
    require_agreement(combination)
    assert "nap" not in render(combination)


def test_modulo_of_numbers_below_zero() -> None:
    rules = (RewardRule(Condition(), parsed("mod(light - 4, 3) + mod(2 - light, 2)")),)
    require_agreement(with_objective(graph_combination(), rules=rules))


def test_numbers_that_are_no_short_fractions() -> None:
    rules = (RewardRule(Condition(), parsed("0.12345678901234 * light + 98765432109876")),)
    combination = with_objective(graph_combination(), rules=rules)
    require_agreement(combination)
    # PRISM-games reads whole numbers of 31 bits
    body = render(combination).split("mdp\n")[1]
    assert max(map(int, re.findall(r"(?<![\w.])\d+(?![\w.])", body))) < 2**31


def test_rewards_and_probabilities_that_read_the_successor() -> None:
    rules = (RewardRule(Condition(), parsed("light' - 2 * light")),)
    combination = with_objective(graph_combination(), rules=rules, ends_in=None)
    require_agreement(combination)
    # S (3) -across-> B (0) loses 6
    assert "const double shift = 7;" in render(combination)


def test_names_of_attributes_that_engines_or_the_text_use_otherwise() -> None:
    graph = graph_combination()
    ice, light = sorted(graph.environment.attributes, key=lambda attribute: attribute.name)
    rules = (
        RewardRule(Condition(where=parsed("P")), parsed("shift' - 1")),
        RewardRule(Condition(), parsed("complete + pay_go + row_east")),
    )
    names = ("shift", "complete", "pay_go", "row_east", "space", "goal", "end")
    attributes = (replace(ice, name="P"), *(replace(light, name=name) for name in names))
    action = ExternalAction(
        "go", (Outcome(0, parsed("P ? 0.5 : 1")), Outcome(None, parsed("P ? 0.5 : 0"))), "stay"
    )
    renamed = with_capability(with_environment(graph, attributes=attributes), external=(action,))
    combination = with_objective(renamed, rules=rules, unsafe=parsed("goal + space + end > 3"))
    require_agreement(combination)


# --- large ones ---


# In a process of their own: what overflows Storm's stack would take the tests with it.
BUILD = """
import sys
from merap.checker.combination_model import build_combination
from merap.families.models import explored
from merap.mdp.comparison import compare
from tests.support.large_spaces import random_graph, random_grid
combination = {"graph": random_graph, "grid": random_grid}[sys.argv[1]](int(sys.argv[2]))
compare(build_combination(combination).mdp, explored(combination)).require_same()
print(explored(combination).num_states)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "size", "least_states"), [("graph", 2000, 4000), ("grid", 100, 6000)])
def test_large_spaces_build_and_agree(kind: str, size: int, least_states: int) -> None:
    command = [sys.executable, "-c", BUILD, kind, str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, timeout=240)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > least_states


def test_the_text_of_large_spaces_is_compact() -> None:
    # 100 x 100 with 3,000 obstacles: four moves, each a box of some 15 characters for an obstacle
    grid = render(random_grid(100))
    assert len(grid) < 4 * 3000 * 25
    assert grid.count("->") == 5 + 5 + 6
    # 2,000 locations with three labels: some 30 characters for a location and label
    assert len(render(random_graph(2000))) < 3 * 2000 * 60


# --- the text as people and other engines read it ---


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes() -> None:
    code = (
        "from tests.support.hand_made import HAND_MADE\n"
        "from merap.prism.rendering import render\n"
        "import sys; sys.stdout.write(''.join(render(combination) for combination in HAND_MADE.values()))"
    )
    texts = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert texts == {"".join(render(combination) for combination in HAND_MADE.values())}


def test_a_small_model_reads_as_written_by_hand() -> None:
    combination = grid_combination(size=3, blocked=cells((1, 1), size=3), goal=(2, 2))
    assert render(combination) == (FIXTURES / "grid_3x3.prism").read_text(encoding="utf-8")


def commands(text: str, module: str) -> list[str]:
    body = text.partition(f"module {module}\n")[2].partition("endmodule")[0]
    return re.findall(r"^  \[(\w+)\]", body, re.MULTILINE)


def test_every_action_stands_in_the_modules_that_know_it() -> None:
    # nowhere to go: `go`, `back` and `jump` are there nevertheless, or they would fire without moving
    text = render(with_environment(graph_combination(), blocked=np.ones(4, dtype=np.bool_)))
    external = ["stop", "go", "back", "jump"]
    assert commands(text, "space") == external
    assert commands(text, "capability") == [*external, "measure", "start_scan"]
    assert commands(text, "objective") == [*external, "measure", "start_scan", "end"]


def test_space_and_capability_are_the_same_for_all_objectives() -> None:
    graph = graph_combination()
    other = with_objective(
        graph,
        name="p",
        rules=(),
        ends_in=None,
        unsafe=None,
        horizon=3,
        goal=at(graph.objective.start > 0),
    )
    texts = [
        render(combination).split("// objective") for combination in (graph, replace(other, name="e.c.p"))
    ]
    assert texts[0][0].removeprefix("// e.c.o\n") == texts[1][0].removeprefix("// e.c.p\n")
    assert texts[0][1] != texts[1][1]


def test_the_header_names_combination_and_sources() -> None:
    lines = render(replace(grid_combination(), name="e.c.met", digest="ab" * 32)).splitlines()
    assert lines[:3] == ["// e.c.met", f"// sources: {'ab' * 32}", "mdp"]


def test_lines_are_no_longer_than_needed() -> None:
    for combination in (*HAND_MADE.values(), random_grid(40), random_combination(3)):
        lines = render(combination).splitlines()
        assert max(map(len, lines)) <= WIDTH
        assert not any(line.endswith(" ") for line in lines)


def test_comparisons_are_spaced_alike() -> None:
    body = re.sub(r"formula \w+ =", "", render(graph_combination()))
    assert not re.search(r"(mode|loc|light\w*) (=|<=|>=|<|>) -?\w", body)


def test_initial_states_without_weights() -> None:
    text = render(graph_combination())
    assert text.endswith("init\n  loc<=1 & mode=0 & !done\nendinit\n")
    assert not re.search(r"\] init|bool init", text)
    single = render(with_objective(graph_combination(), start=np.array([0.0, 1, 0, 0])))
    assert "loc : [0..3] init 1;" in single
    assert "endinit" not in single
