"""Whatever a user may print of a case fits on a screen."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from merap.concerns.case_study import CaseStudy, load_declared_case
from merap.families.loading import load_case
from merap.families.models import explored
from merap.program.expressions import parse
from tests.support.case_examples import GRAPH, write_case
from tests.support.shipped_cases import CASE_FILES


def parts(value: Any, seen: set[int]) -> Iterator[Any]:
    """Every record of merap that can be reached from a value by its fields and entries."""
    if id(value) in seen or isinstance(value, str | bytes | np.ndarray):
        return
    seen.add(id(value))
    if isinstance(value, Mapping):
        inside = list(value.values())
    elif isinstance(value, Collection):
        inside = list(value)[:50]
    elif is_dataclass(value):
        yield value
        inside = [getattr(value, field.name) for field in fields(value)]
    elif isinstance(value, BaseModel):
        yield value
        inside = [part for _, part in value]
    else:
        return
    for part in inside:
        yield from parts(part, seen)


def require_short(case: CaseStudy) -> None:
    combination = case.combination_at(0)
    seen: set[int] = set()
    for root in (case, combination, explored(combination)):
        for part in parts(root, seen):
            if type(part).__module__.startswith("merap") and type(part).__name__ != "Document":
                assert len(repr(part)) <= 300, type(part)


@pytest.mark.parametrize("path", CASE_FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_shipped_cases(path: Any) -> None:
    require_short(load_case(path))


def test_a_graph_with_everything(tmp_path: Any) -> None:
    case = load_declared_case(write_case(tmp_path, GRAPH))
    require_short(case)
    assert repr(case).startswith("DeclaredCase(name='small_graph', source=PosixPath(")
    assert repr(case.space.attributes[0]) == (
        "Attribute(name='light', kind='int', low=0.0, high=3.0, values=float64[4])"
    )
    assert "environment=<Environment open>" in repr(case.combination_at(0))


def test_a_long_expression() -> None:
    assert len(repr(parse(" + ".join(["light"] * 90)))) <= 300
