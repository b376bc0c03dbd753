"""Whatever stands in a file, `load_declared_case` returns a case or raises a `MerapError`."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from merap.concerns.case_study import load_declared_case
from merap.concerns.schema_program import case_schema
from merap.errors import MerapError
from merap.families.models import explored
from merap.mapek.scenario import read_scenario
from merap.runs.settings import read_config
from tests.support.case_examples import GRAPH, GRID

# The size of the temporary folder does not matter, and machines that run tests may be slow.
RELAXED = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
FEW = settings(RELAXED, max_examples=25)
MANY = settings(RELAXED, max_examples=100)

EXAMPLES = [YAML(typ="safe", pure=True).load(text) for text in (GRID, GRAPH)]


def words(tree: Any) -> set[str]:
    """Every text in a tree: keys, names, expressions."""
    if isinstance(tree, dict):
        return set(tree) | {word for value in tree.values() for word in words(value)}
    if isinstance(tree, list):
        return {word for value in tree for word in words(value)}
    return {tree} if isinstance(tree, str) else set()


KNOWN_WORDS = sorted({word for tree in EXAMPLES for word in words(tree)} | words(case_schema()["$defs"]))

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 12),
    st.integers(),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(KNOWN_WORDS),
)
keys = st.one_of(st.sampled_from(KNOWN_WORDS), st.text(max_size=6))
trees = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner, max_size=4),
    max_leaves=12,
)


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path of every value below the root."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [place for key, value in items for place in ((*path, key), *places(value, (*path, key)))]


def value_at(tree: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        tree = tree[key]
    return tree


@st.composite
def mutated_cases(draw: st.DrawFn) -> Any:
    """A valid case after one to three changes: a value replaced, removed, copied or renamed."""
    case = copy.deepcopy(draw(st.sampled_from(EXAMPLES)))
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(places(case)))
        parent, key = value_at(case, path[:-1]), path[-1]
        change = draw(st.sampled_from(["replace", "remove", "copy", "rename"]))
        if change == "remove":
            del parent[key]
        elif change == "rename" and isinstance(parent, dict):
            parent[draw(keys)] = parent.pop(key)
        elif change == "copy":
            parent[key] = copy.deepcopy(value_at(case, draw(st.sampled_from(places(case)))))
        else:
            parent[key] = draw(trees)
        if not places(case):
            break
    return case


def refusal(call: Callable[[], Any]) -> str | None:
    """The message of the `MerapError` that a call raises."""
    try:
        call()
    except MerapError as error:
        return str(error)
    return None


def load_or_refuse(folder: Path, content: bytes) -> None:
    path = folder / "case.yaml"
    path.write_bytes(content)
    try:
        case = load_declared_case(path)
        for system in case.systems.values():
            explored(system)
    except MerapError as error:
        message = str(error)
        assert message.startswith(str(path)) or "has no action" in message
        assert "\n" not in message


@FEW
@given(tree=trees)
def test_arbitrary_trees(tmp_path: Path, tree: Any) -> None:
    load_or_refuse(tmp_path, json.dumps(tree).encode())


@FEW
@given(tree=st.fixed_dictionaries(dict.fromkeys(case_schema()["$defs"]["CaseSpec"]["properties"], trees)))
def test_arbitrary_concerns(tmp_path: Path, tree: Any) -> None:
    load_or_refuse(tmp_path, json.dumps(tree).encode())


@MANY
@given(case=mutated_cases())
def test_mutated_cases(tmp_path: Path, case: Any) -> None:
    load_or_refuse(tmp_path, json.dumps(case).encode())


@FEW
@given(content=st.binary(max_size=60))
def test_arbitrary_bytes(tmp_path: Path, content: bytes) -> None:
    load_or_refuse(tmp_path, content)


@FEW
@given(text=st.text(st.sampled_from("ab: -[]{},&*!|>'\"#%@`\n\t?~01"), max_size=60))
def test_arbitrary_yaml(tmp_path: Path, text: str) -> None:
    load_or_refuse(tmp_path, text.encode())


# What YAML gives a meaning, and what its readers stumble over.
FRAGMENTS = (
    *(
        "a",
        "b: ",
        "- ",
        "? ",
        ": ",
        "\n",
        "\n  ",
        "\t",
        '"',
        "'",
        "\\",
        "|",
        ">-",
        "&a ",
        "*a ",
        "[",
        "]",
        "{",
        "}",
        ",",
    ),
    *(
        "!",
        "!!int ",
        "!!float ",
        "!!bool ",
        "!!binary ",
        "!!set ",
        "!!omap ",
        "!<",
        "!!timestamp ",
        "!!str ",
        "<<: ",
    ),
    *("%YAML 1.1\n---\n", "%YAML 1.3\n---\n", "%YAML 1." + "9" * 5000 + "\n", "%TAG ! x\n", "---\n", "...\n"),
    *(
        '"\\UFFFFFFFF"',
        '"\\U00110000"',
        '"\\ud800"',
        '"\\ud83d\\ude00"',
        "\\x",
        "\\N",
        "#",
        "@",
        "`",
        "=",
        "~",
        "%ff",
    ),
    *(
        "9" * 400,
        "-" + "9" * 5000,
        "0x" + "f" * 400,
        "1e999",
        "-1e999",
        ".nan",
        "-.inf",
        "1_0",
        "010",
        "1:30",
        "0b1",
    ),
    *(
        "on",
        "yes",
        "2020-01-01",
        "2020-99-99",
        "\u2028",
        "\x85",
        "\ufeff",
        "\r",
        "\x00",
        "\x7f",
        "\U0001f600",
        "- " * 150,
    ),
)
fragments = st.lists(st.sampled_from(FRAGMENTS), max_size=12).map("".join)


@MANY
@given(text=fragments)
def test_fragments_of_yaml(tmp_path: Path, text: str) -> None:
    load_or_refuse(tmp_path, text.encode())


@MANY
@given(key=st.sampled_from(KNOWN_WORDS), text=fragments)
def test_fragments_in_every_other_file(tmp_path: Path, key: str, text: str) -> None:
    """Scenarios, files of settings, and settings of the command line."""
    path = tmp_path / "other.yaml"
    path.write_text(f"{key}: {text}", encoding="utf-8", newline="")
    calls: list[tuple[str, Callable[[], Any]]] = [
        (str(path), lambda: read_scenario(path)),
        (str(path), lambda: read_config(path, [])),
        ("--set", lambda: read_config(None, [f"updates={text}"])),
        ("--set", lambda: read_config(None, [f"hidden={text}"])),
    ]
    for source, call in calls:
        message = refusal(call) or source
        assert message.startswith(source)
        assert "\n" not in message


@pytest.mark.parametrize("example", EXAMPLES, ids=["grid", "graph"])
def test_the_unchanged_examples_load(tmp_path: Path, example: Any) -> None:
    """The mutations start from something valid, so they reach every stage of loading."""
    path = tmp_path / "case.yaml"
    path.write_text(json.dumps(example))
    assert load_declared_case(path).size > 1
