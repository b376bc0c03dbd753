"""Read and pack state valuations, which UMB keeps as bit fields in little-endian records of whole bytes.

Axes: S states, V variables.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from merap.errors import InputError, ModelError
from merap.mdp.model import Ints, check_range
from merap.mdp.umb_archive import Archive
from merap.mdp.umb_index import Index, PackedVariable, Padding, ValuationClass, Valuations, ValueType

Bytes = npt.NDArray[np.uint8]

VALUATIONS_ENTRY = "valuations/states/valuations.bin"
CLASS_ENTRY = "valuations/states/valuation-to-class.bin"
# Storm adds this bit when it is told to build a state for assignments out of range.
OUT_OF_BOUNDS_BIT = "_OutOfBoundsBit"

_WIDTHS = (8, 16, 32, 64)


def read_valuations(archive: Archive, index: Index) -> tuple[tuple[str, ...], Ints]:
    """Read names and values of the state variables; Booleans as 0 and 1.

    Returns:
        V names in the archive's order, int64 [S, V].

    Raises:
        InputError: there are none, one is neither an integer nor a Boolean, or a value is outside
            of the bounds that the index declares.
        ModelError: a state is marked as out of bounds.
    """
    packing = _single_class(archive, index)
    records, fields = _records(archive, index, packing)
    columns = {field.name: _decode(records, field, start, archive.source) for field, start in fields}
    stray = columns.pop(OUT_OF_BOUNDS_BIT, None)
    if stray is not None and stray.any():
        raise ModelError("an update takes a variable out of its range")
    for field, _ in fields:
        if field.name in columns:
            _check_bounds(field, columns[field.name], archive.source)
    if len(columns) + (stray is not None) != len(fields):
        raise InputError("two state variables have one name", source=archive.source)
    values = np.empty((len(records), len(columns)), dtype=np.int64)
    for position, column in enumerate(columns.values()):
        values[:, position] = column
    return tuple(columns), values


def _single_class(archive: Archive, index: Index) -> ValuationClass:
    if "states" not in index.valuations:
        raise InputError("no state valuations; export the model with them", source=archive.source)
    classes = index.valuations["states"].classes
    if len(classes) != 1:
        raise InputError(f"{len(classes)} classes of state valuations, 1 is allowed", source=archive.source)
    number = archive.numbers(CLASS_ENTRY, index.transition_system.num_states, optional=True)
    check_range(CLASS_ENTRY, number, len(classes))
    return classes[0]


def _records(
    archive: Archive, index: Index, packing: ValuationClass
) -> tuple[Bytes, list[tuple[PackedVariable, int]]]:
    """Return the packed records, uint8 [S, bytes], and each variable with its first bit."""
    fields = []
    bits = 0
    for entry in packing.variables:
        if isinstance(entry, Padding):
            bits += entry.padding
            continue
        _check_supported(entry, archive.source)
        fields.append((entry, bits))
        bits += entry.type.size
    if bits % 8:
        raise InputError(f"a state valuation has {bits} bits, not whole bytes", source=archive.source)
    states = index.transition_system.num_states
    content = archive.array(VALUATIONS_ENTRY, "u1", states * (bits // 8))
    return content.reshape(states, bits // 8), fields


def _check_supported(variable: PackedVariable, source: str) -> None:
    kind, bits = variable.type.type, variable.type.size
    if kind not in {"bool", "int", "uint"} or bits > 64 or variable.is_optional:
        kind_text = f"{'optional ' if variable.is_optional else ''}{kind} of {bits} bits"
        raise InputError(
            f"state variable {variable.name!r} is {kind_text}; allowed are bool, int and uint up to 64",
            source=source,
        )


def _check_bounds(variable: PackedVariable, values: Ints, source: str) -> None:
    low, high = int(values.min()), int(values.max())
    least = low if variable.lower is None else variable.lower
    greatest = high if variable.upper is None else variable.upper
    if variable.type.type != "bool" and not least <= low <= high <= greatest:
        raise InputError(
            f"state variable {variable.name!r} has values {low}..{high}, declared are {least}..{greatest}",
            source=source,
        )


def _decode(records: Bytes, variable: PackedVariable, start: int, source: str) -> Ints:
    bits = variable.type.size
    raw = _extract(records, start, bits)
    if variable.type.type == "bool":
        return np.minimum(raw, np.uint64(1)).view(np.int64)
    if variable.type.type == "int":
        # Two's complement of `bits` bits: move the sign to the top and back.
        value = (raw << np.uint64(64 - bits)).view(np.int64) >> np.int64(64 - bits)
    else:
        value = raw.view(np.int64)
    low, high = int(value.min()), int(value.max())
    past_sign = variable.type.type == "uint" and low < 0
    if past_sign or not -(2**63) <= low + variable.offset <= high + variable.offset < 2**63:
        raise InputError(f"state variable {variable.name!r} has values past 64 bits", source=source)
    decoded: Ints = value + np.int64(variable.offset)
    return decoded


def _extract(records: Bytes, start: int, bits: int) -> npt.NDArray[np.uint64]:
    """Extract bits start..start + bits - 1 of each record, uint64 [S]; loops over the bytes they touch."""
    value = np.zeros(len(records), dtype=np.uint64)
    first = start // 8
    for byte in range(first, (start + bits - 1) // 8 + 1):
        shift = 8 * byte - start
        part = records[:, byte].astype(np.uint64)
        value |= part << np.uint64(shift) if shift >= 0 else part >> np.uint64(-shift)
    return value if bits == 64 else value & np.uint64((1 << bits) - 1)


def pack_valuations(names: tuple[str, ...], values: Ints) -> tuple[Valuations, Bytes]:
    """Pack the valuations in whole bytes, each variable as unsigned above its minimum.

    Args:
        names: V names.
        values: int64 [S, V].

    Returns:
        The description for the index; uint8 [S, bytes].
    """
    variables: list[PackedVariable | Padding] = []
    columns: list[Bytes] = []
    for name, column in zip(names, values.T, strict=True):
        variable, stored = _pack_column(name, column)
        variables.append(variable)
        columns.append(stored)
    if not variables:
        variables.append(Padding(padding=8))
        columns.append(np.zeros((len(values), 1), dtype=np.uint8))
    packing = ValuationClass(variables=tuple(variables))
    return Valuations(unique=True, classes=(packing,)), np.concatenate(columns, axis=1)


def _pack_column(name: str, column: Ints) -> tuple[PackedVariable, Bytes]:
    low, high = int(column.min()), int(column.max())
    bits = next((width for width in _WIDTHS if high - low < 1 << width), 64)
    signed = bits == 64
    offset = 0 if signed else low
    stored = (column - offset).astype(f"<{'i' if signed else 'u'}{bits // 8}")
    kind = ValueType(type="int" if signed else "uint", size=bits)
    variable = PackedVariable(name=name, type=kind, lower=low, upper=high, offset=offset)
    return variable, stored.view(np.uint8).reshape(len(column), bits // 8)
