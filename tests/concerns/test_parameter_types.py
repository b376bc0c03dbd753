"""Types of parameters: domains, generated configurations over them, and what is refused."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from merap.concerns.case_study import CaseStudy, load_declared_case
from merap.concerns.parameter_types import parameter_type
from merap.concerns.schema_program import case_schema
from merap.errors import InputError
from tests.support.case_examples import GRAPH, GRID, replaced, write_case

TYPES = """\
    level: {int: [-1, 2]}
    gain: {real: [-0.5, 2]}
    odds: {probability: [0.1, 0.5]}
    armed: bool
    colour: {values: [red, green]}
    size: {values: [1, 2.5, -3]}
    dock: location
    zone: locations
    route: edges
"""
GIVEN = """\
    one:
      {level: 2, gain: -0.5, odds: 0.1, armed: true, colour: green, size: 2.5, dock: G,
       zone: [A, B], route: [[S, A]]}
"""


def with_types(folder: Path, types: str = TYPES, configurations: str = GIVEN) -> CaseStudy:
    head = GRAPH[: GRAPH.index("objective:\n")]
    text = f"""\
{head}objective:
  parameters:
{types}  start: S
  horizon: 3
  configurations:
{configurations}"""
    return load_declared_case(write_case(folder, text))


def test_values_are_kept_as_given(tmp_path: Path) -> None:
    case = with_types(tmp_path)
    assert case.supports.objective[0].parameters == {
        "level": 2,
        "gain": -0.5,
        "odds": 0.1,
        "armed": True,
        "colour": "green",
        "size": 2.5,
        "dock": "G",
        "zone": ["A", "B"],
        "route": [["S", "A", "east"]],
    }


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("level: 2", "level: 3", "3 is outside the parameter's domain, -1 to 2"),
        ("level: 2", "level: 1.5", "expected a whole number, got 1.5"),
        ("gain: -0.5", "gain: 2.01", "2.01 is outside the parameter's domain, -0.5 to 2"),
        ("odds: 0.1,", "odds: 0.09,", "0.09 is outside the parameter's domain, 0.1 to 0.5"),
        ("armed: true", "armed: 1", "expected true or false, got 1"),
        ("colour: green", "colour: gren", "'gren' is none of the parameter's values; did you mean 'green'"),
        ("size: 2.5", "size: 2", "2 is none of the parameter's values"),
        ("size: 2.5", "size: red", "'red' is none of the parameter's values; known: 1, 2.5, -3"),
    ],
)
def test_a_value_outside_its_domain_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        with_types(tmp_path, configurations=replaced(GIVEN, old, new))
    assert message in caught.value.message
    assert caught.value.key is not None
    assert caught.value.key.startswith("objective.configurations.one.")


@pytest.mark.parametrize(
    ("type_", "message"),
    [
        ("{int: [2, 1]}", "whole numbers with least <= greatest"),
        ("{int: [0, 1.5]}", "whole numbers with least <= greatest"),
        ("{real: 3}", "expected [least, greatest] as numbers"),
        ("{probability: [0, 1.5]}", "expected probabilities in [0, 1]"),
        ("{values: []}", "expected a list of values"),
        ("{values: [a, 1]}", "names alone or numbers alone"),
        ("{values: [a, a]}", "a value stands twice"),
        ("{values: [a b]}", "illegal name 'a b' of a value"),
        ("{bool: [0, 1]}", "expected a type: location"),
        ("number", "expected a type: location"),
    ],
)
def test_types_that_are_none(tmp_path: Path, type_: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        with_types(tmp_path, f"    level: {type_}\n", "    one: {level: 1}\n")
    assert message in caught.value.message
    assert (caught.value.key or "").startswith("objective.parameters.level")


EDITOR = jsonschema.Draft202012Validator(case_schema())


@pytest.mark.parametrize(
    ("type_", "fits"),
    [
        *((f"{name}", True) for name in ("int", "bool", "edges")),
        ("{int: [0, 3]}", True),
        ("{values: [a, b]}", True),
        ("{int: [0.5, 3]}", False),
        ("{values: []}", False),
        ("{bool: [0, 1]}", False),
        ("text", False),
    ],
)
def test_the_json_schema_agrees(type_: str, fits: bool) -> None:
    data: Any = YAML(typ="safe", pure=True).load(GRID)
    data["objective"]["parameters"]["level"] = YAML(typ="safe", pure=True).load(type_)
    assert EDITOR.is_valid(data) is fits


GENERATED = [
    ("{int: [-1, 2]}", "{from: all}", [-1, 0, 1, 2], ["m1", "0", "1", "2"]),
    ("{int: [-1, 2]}", "{from: all, except: [0]}", [-1, 1, 2], ["m1", "1", "2"]),
    ("int", "{from: [5, 3]}", [5, 3], ["5", "3"]),
    ("{real: [0, 1]}", "{from: [0.5, 1]}", [0.5, 1.0], ["0p5", "1p0"]),
    ("bool", "{from: all}", [False, True], ["false", "true"]),
    ("{values: [red, green]}", "{from: all}", ["red", "green"], ["red", "green"]),
    ("{values: [red, green, blue]}", "{from: all, except: [green]}", ["red", "blue"], ["red", "blue"]),
    ("{values: [0.5, 2]}", "{from: all}", [0.5, 2], ["0p5", "2"]),
    ("location", "{from: all}", ["S", "A", "B", "G"], ["S", "A", "B", "G"]),
    ("locations", "{choose: 3, from: all, except: S}", [["A", "B", "G"]], ["A_B_G"]),
    ("edges", "{choose: 1, from: [[S, A], [A, G]]}", [[["S", "A", "east"]], [["A", "G", "east"]]], None),
]


@pytest.mark.parametrize(("type_", "choice", "values", "names"), GENERATED)
def test_every_type_can_be_generated(
    tmp_path: Path, type_: str, choice: str, values: list[Any], names: list[str] | None
) -> None:
    case = with_types(tmp_path, f"    p: {type_}\n", f"    generate: {{p: {choice}}}\n")
    support = case.supports.objective
    assert [one.parameters["p"] for one in support] == values
    for index, name in enumerate(support.names()):
        assert support.index(name) == index
        assert names is None or name == f"p_{names[index]}"


def test_all_edges_of_the_space(tmp_path: Path) -> None:
    case = with_types(tmp_path, "    p: edges\n", "    generate: {p: {choose: 2, from: all}}\n")
    assert case.supports.objective.count == len(list(itertools.combinations(range(6), 2)))


def test_a_family_too_large_to_enumerate_is_found_by_index(tmp_path: Path) -> None:
    types = "".join(f"    p{index}: {{int: [0, 99999]}}\n" for index in range(3))
    choices = ", ".join(f"p{index}: {{from: all}}" for index in range(3))
    support = with_types(tmp_path, types, f"    generate: {{{choices}}}\n").supports.objective
    assert support.count == 10**15
    index = 123_456_789_012_345
    assert support[index].parameters == {"p0": 12345, "p1": 67890, "p2": 12345}
    assert support.index(support.name(index)) == index


@pytest.mark.parametrize(
    ("type_", "choice", "message"),
    [
        ("int", "{from: all}", "all needs a domain, as {int: [0, 3]}: this parameter is of type int"),
        ("{real: [0, 1]}", "{from: all}", "all needs a list of values: this parameter is of type real"),
        ("probability", "{from: all}", "all needs a list of values"),
        ("{int: [0, 9999999]}", "{from: all}", "all are 10000000 values, at most 1000000 are allowed"),
        ("{int: [0, 3]}", "{from: [4]}", "4 is outside the parameter's domain, 0 to 3"),
        ("{int: [0, 3]}", "{from: 2}", "expected a list of values, or all, got 2"),
        ("{int: [0, 3]}", "{choose: 2, from: all}", "choose is for sets, as locations, not for int"),
        ("{int: [0, 1]}", "{from: all, except: [0, 1]}", "1 can't be chosen from 0 members"),
    ],
)
def test_choices_that_are_refused(tmp_path: Path, type_: str, choice: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        with_types(tmp_path, f"    p: {type_}\n", f"    generate: {{p: {choice}}}\n")
    assert message in caught.value.message
    assert (caught.value.key or "").startswith("objective.configurations.generate.p")


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ("locations", "locations"),
        ("real", "real"),
        ({"int": (0, 3)}, "int 0..3"),
        ({"probability": (0, 0.25)}, "probability 0..0.25"),
        ({"values": ("low", "high")}, "low, high"),
        ({"values": (1, 2.5)}, "1, 2.5"),
    ],
)
def test_a_type_reads_as_its_name_and_domain(given: object, text: str) -> None:
    assert parameter_type(given).text == text
