"""Archives damaged in every layer are refused by a MerapError, or still hold a model."""

from __future__ import annotations

import gzip
import json
import lzma
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from merap.errors import MerapError
from merap.mdp.model import TabularMDP
from merap.mdp.umb import read_umb, write_umb
from tests.support.mdp_examples import puterman_two_states
from tests.support.umb_example import saved, standard_example, tar_bytes

NAMES = list(standard_example()[1])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=4,
)
KEYS = ["annotations", "aps", "rewards", "g", "type", "size", "#states", "#choices", "#branches", "alias"]


def read_or_refuse(data: bytes) -> bool:
    """Tell whether the data is refused.

    Any exception but a MerapError, or a crash, fails: the reader indexes memory by what it reads.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            mdp = read_umb(saved(Path(folder) / "mdp.umb", data), reward="r")
        except MerapError as error:
            refused, lines = True, str(error).splitlines()
        else:
            refused = False
            lines = [mdp.describe_choice(choice) for choice in range(min(1, mdp.num_choices))]
    assert len(lines) == 1
    return refused


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) inside a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield value, key
        yield from places(inner)


@settings(max_examples=120, deadline=None)
@given(st.data())
def test_an_index_with_other_values(data: st.DataObject) -> None:
    index, entries = standard_example()
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(list(places(index))))
        small = st.integers(-1, 9) | st.sampled_from(
            ["double", "rational", "uint", "int", "bool", "states", "g"]
        )
        container[key] = data.draw(small | JSON)
        if isinstance(container, dict) and data.draw(st.booleans()):
            container[data.draw(st.sampled_from(KEYS) | st.text(max_size=4))] = container.pop(key)
    read_or_refuse(tar_bytes(json.dumps(index).encode(), entries))


@settings(max_examples=120, deadline=None)
@given(st.data())
def test_entries_with_other_bytes(data: st.DataObject) -> None:
    index, entries = standard_example()
    for name in data.draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True)):
        content = bytearray(entries.pop(name))
        kind = data.draw(st.sampled_from(["absent", "resized", "bytes"]))
        if kind == "resized":
            entries[name] = data.draw(st.binary(max_size=80))
        elif kind == "bytes":
            for _ in range(data.draw(st.integers(1, 4))):
                content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
            entries[name] = bytes(content)
    read_or_refuse(tar_bytes(index, entries))


@settings(max_examples=120, deadline=None)
@given(st.data(), st.sampled_from([bytes, lambda data: gzip.compress(data, mtime=0), lzma.compress]))
def test_files_with_other_bytes(data: st.DataObject, compress: Any) -> None:
    whole = bytearray(compress(tar_bytes(*standard_example())))
    used = np.flatnonzero(np.frombuffer(whole, dtype=np.uint8)).tolist()
    for _ in range(data.draw(st.integers(0, 5))):
        whole[data.draw(st.sampled_from(used))] = data.draw(st.integers(0, 255))
    read_or_refuse(bytes(whole[: data.draw(st.integers(0, len(whole)) | st.just(len(whole)))]))


@pytest.mark.parametrize("seed", range(8))
def test_most_damage_is_noticed(seed: int) -> None:
    generator = np.random.default_rng(seed)
    whole = np.frombuffer(tar_bytes(*standard_example()), dtype=np.uint8)
    refused = 0
    for _ in range(60):
        damaged = whole.copy()
        spots = generator.choice(np.flatnonzero(whole), size=int(generator.integers(1, 6)))
        damaged[spots] = generator.integers(0, 256, size=len(spots))
        refused += read_or_refuse(damaged.tobytes())
    assert refused > 20


@settings(max_examples=100, deadline=None)
@given(st.lists(st.text("aA-_2é \x00", max_size=4) | st.text(max_size=60), unique=True, max_size=12))
def test_every_label_is_kept_whatever_its_name(names: list[str]) -> None:
    names = [name for name in names if name != "init"]
    two = puterman_two_states()
    masks = {
        name: np.array([position & 1, position & 2], dtype=np.bool_) for position, name in enumerate(names)
    }
    labelled = TabularMDP(**{**{f: getattr(two, f) for f in two.__dataclass_fields__}, "labels": masks})
    with tempfile.TemporaryDirectory() as folder:
        write_umb(labelled, Path(folder) / "mdp.umb")
        copy = read_umb(Path(folder) / "mdp.umb")
    assert list(copy.labels) == names
    for name, mask in masks.items():
        assert copy.labels[name].tolist() == mask.tolist()
