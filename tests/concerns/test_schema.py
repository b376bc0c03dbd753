from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from merap.concerns.schema import CaseSpec
from merap.concerns.schema_base import Box
from merap.concerns.schema_objective import PredicateSpec
from merap.concerns.schema_program import case_schema
from merap.concerns.validation import validate
from merap.concerns.yaml_file import read_document
from tests.support.bad_cases import KEYS_AND_TYPES
from tests.support.case_examples import GRAPH, GRID, replaced, write_case
from tests.support.paths import MODELS

SHIPPED = [
    MODELS / "running-example" / "case.yaml",
    MODELS / "hazard-grid" / "case.yaml",
    MODELS / "frozen-lake" / "case.yaml",
    *sorted((MODELS / "paper-grid").glob("*.yaml")),
]


def data(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def parse(folder: Path, text: str) -> CaseSpec:
    return validate(read_document(write_case(folder, text)), CaseSpec)


def editor_schema() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(case_schema())


def test_the_json_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(case_schema())


@pytest.mark.parametrize("text", [GRID, GRAPH, *(path.read_text() for path in SHIPPED)])
def test_the_json_schema_accepts_what_loads(text: str) -> None:
    """Second route: an editor checks with a JSON Schema validator, merap with pydantic."""
    assert [error.message for error in editor_schema().iter_errors(data(text))] == []


# What a JSON Schema can't say: .nan is refused by the YAML reader, forms that exclude each other by pydantic.
NOT_IN_JSON_SCHEMA = {
    "horizon: soon",
    "discount: .nan\n",
    "    stop: {stay: 1, move: east}",
    "{stay: 1, probability: 1}",
    "    lidar: {of: heat,",
}


@pytest.mark.parametrize(
    ("old", "new"), [row[:2] for row in KEYS_AND_TYPES if row[1] not in NOT_IN_JSON_SCHEMA]
)
def test_the_json_schema_refuses_what_pydantic_refuses(old: str, new: str) -> None:
    assert not editor_schema().is_valid(data(replaced(GRAPH, old, new)))


def described(schema: Any) -> list[str]:
    """Properties of the schema's models that have no description."""
    return [
        f"{model}.{name}"
        for model, content in schema["$defs"].items()
        for name, field in content.get("properties", {}).items()
        if not field.get("description")
    ]


def test_every_key_is_described() -> None:
    schema = case_schema()
    assert described(schema) == []
    assert all(content["description"] for content in schema["$defs"].values())


def test_forms_of_locations(tmp_path: Path) -> None:
    text = replaced(GRID, "ends_after: {at: goal}", "ends_after: {at: [[0, 1], [2, 2]]}")
    spec = parse(tmp_path, text)
    assert spec.objective.rewards[0].at == ("goal",)
    assert spec.objective.ends_after is not None
    assert spec.objective.ends_after.at == ((0, 1), (2, 2))
    one = parse(tmp_path, replaced(GRID, "ends_after: {at: goal}", "ends_after: {at: [2, 2]}"))
    assert one.objective.ends_after is not None
    assert one.objective.ends_after.at == ((2, 2),)
    box = parse(
        tmp_path, replaced(GRID, "ends_after: {at: goal}", "ends_after: {at: {rows: [0, 1], cols: [2, 2]}}")
    )
    assert box.objective.ends_after is not None
    assert box.objective.ends_after.at == Box((0, 1), (2, 2))


def test_a_predicate_may_be_an_expression_alone(tmp_path: Path) -> None:
    short = parse(tmp_path, replaced(GRAPH, "  unsafe: light = 0 & mode != scanning", "  unsafe: light = 0"))
    long = parse(
        tmp_path, replaced(GRAPH, "  unsafe: light = 0 & mode != scanning", "  unsafe: {where: light = 0}")
    )
    assert short.objective.unsafe == long.objective.unsafe == PredicateSpec(where="light = 0")


@pytest.mark.parametrize(
    "start",
    ["{S: 0.75, A: 0.25}", "[{at: S, probability: 0.75}, {at: A, probability: 0.25}]"],
)
def test_forms_of_start_distributions(tmp_path: Path, start: str) -> None:
    spec = parse(tmp_path, replaced(GRAPH, "{S: 0.75, A: 0.25}", start))
    assert [(point.at, point.probability) for point in spec.objective.start] == [("S", 0.75), ("A", 0.25)]


def test_the_kind_of_an_attribute_follows_its_range(tmp_path: Path) -> None:
    space = parse(tmp_path, GRAPH).space
    assert space is not None
    kinds = {name: attribute.type for name, attribute in space.attributes.items()}
    assert kinds == {"light": "int", "slippery": "bool", "slope": "real"}


def test_a_spec_is_frozen(tmp_path: Path) -> None:
    spec = parse(tmp_path, GRID)
    with pytest.raises(ValueError, match="frozen"):
        spec.discount = 0.5
