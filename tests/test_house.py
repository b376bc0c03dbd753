"""Rules of the house that no linter of ours states: names, lengths, and who imports whom."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = ("merap", "tests", "scripts")
MAX_LINES = 300


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(path: Path) -> Iterator[str]:
    """Modules and names that a file imports, those inside functions and for types alone included."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def folder(name: str) -> str:
    """The folder of merap that a module or name is in, or the module itself beside the folders."""
    return name.split(".")[1]


def test_no_public_class_name_is_used_twice() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for path in python_files("merap"):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(module_name(path))
    assert {name: found for name, found in homes.items() if len(found) > 1} == {}


def test_no_file_is_long() -> None:
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in python_files(*PROJECT)
    }
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def folder_imports() -> nx.DiGraph[str]:
    graph: nx.DiGraph[str] = nx.DiGraph()
    for path in python_files("merap"):
        name = module_name(path)
        if name == "merap":  # the face of the library, which no folder imports
            continue
        for other in imported(path):
            if other.startswith("merap.") and folder(other) != folder(name):
                graph.add_edge(folder(name), folder(other))
    return graph


def test_folders_import_each_other_in_no_circle() -> None:
    graph = folder_imports()
    assert {"cli", "mapek", "shield", "mdp"} <= set(graph)
    assert list(nx.simple_cycles(graph)) == []


@pytest.mark.parametrize("path", python_files("tests"), ids=module_name)
def test_no_test_module_is_imported(path: Path) -> None:
    """Helpers live in modules without tests, so that a test can be moved or run alone."""
    names = {part for name in imported(path) if name.startswith("tests.") for part in name.split(".")}
    assert [name for name in sorted(names) if name.startswith("test_")] == []
