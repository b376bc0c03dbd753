"""Bit-packed valuations, against the standard and against integer arithmetic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.mdp.umb import read_umb
from tests.support.umb_example import saved, standard_example, tar_bytes


def with_variables(variables: list[dict[str, object]], records: bytes) -> bytes:
    index, entries = standard_example()
    index["valuations"]["states"]["classes"] = [{"variables": variables}]
    entries["valuations/states/valuations.bin"] = records
    return tar_bytes(index, entries)


def test_packed_valuations_with_offsets_as_the_standard_shows(tmp_path: Path) -> None:
    # Example 2 of the standard: sv0 = 56, sv1 = -16897, three bytes; further states by hand.
    variables: list[dict[str, object]] = [
        {"name": "sv0", "type": {"type": "uint", "size": 8}, "offset": -128},
        {"name": "sv1", "type": {"type": "int", "size": 16}},
    ]
    first = bytes([0b10111000, 0b11111111, 0b10111101])
    records = first + bytes([0, 0, 0]) + bytes([255, 0xFF, 0x7F]) + bytes([128, 0x00, 0x80])
    mdp = read_umb(saved(tmp_path / "mdp.umb", with_variables(variables, records)), reward=None)
    assert mdp.variable_names == ("sv0", "sv1")
    assert mdp.valuations.tolist() == [[56, -16897], [-128, 0], [127, 32767], [0, -32768]]


@pytest.mark.parametrize("seed", range(10))
def test_packed_valuations_against_integer_arithmetic(tmp_path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    variables: list[dict[str, object]] = []
    rows = [0] * 4
    expected: list[list[int]] = [[] for _ in rows]
    bits = 0
    for name in "abcdef":
        if generator.random() < 0.4:
            gap = int(generator.integers(1, 12))
            variables.append({"padding": gap})
            bits += gap
        kind = str(generator.choice(["bool", "int", "uint"]))
        size = int(generator.integers(1, 64))
        offset = 0 if kind == "bool" else int(generator.integers(-1000, 1000))
        variables.append({"name": name, "type": {"type": kind, "size": size}, "offset": offset})
        for row in range(4):
            stored = int.from_bytes(generator.bytes(8), "little") % 2**size
            rows[row] += stored << bits
            signed = stored - 2**size if kind == "int" and stored >= 2 ** (size - 1) else stored
            expected[row].append(int(stored > 0) if kind == "bool" else signed + offset)
        bits += size
    variables.append({"padding": 8 + -bits % 8})
    records = b"".join(row.to_bytes((bits + -bits % 8) // 8 + 1, "little") for row in rows)
    mdp = read_umb(saved(tmp_path / "mdp.umb", with_variables(variables, records)), reward=None)
    assert mdp.valuations.tolist() == expected
