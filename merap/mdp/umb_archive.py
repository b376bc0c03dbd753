"""Read and write the tar file around a UMB model: entries are views into the mapped file."""

from __future__ import annotations

import gzip
import io
import lzma
import mmap
import os
import tarfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import InputError, OutputError
from merap.mdp.model import Bools, Floats
from merap.mdp.umb_index import ValueType

_GZIP_MAGIC = b"\x1f\x8b\x08"
_XZ_MAGIC = b"\xfd7zXZ\x00"
_DAMAGE = (tarfile.TarError, zlib.error, lzma.LZMAError, gzip.BadGzipFile, EOFError, ValueError)


@dataclass(frozen=True)
class Archive:
    """The entries of an archive, without copies.

    Attributes:
        source: the file, for messages.
        entries: name -> bytes; they keep the mapped file alive.
        complete: whether the mark that ends a tar file is there; without it an entry that is
            absent may have been cut off.
    """

    source: str
    entries: Mapping[str, memoryview]
    complete: bool

    def has(self, name: str) -> bool:
        """Tell whether an entry is there; the format must allow to leave it out.

        Raises:
            InputError: it is absent, and the end of the file is missing.
        """
        if name not in self.entries and not self.complete:
            raise InputError(f"the file is cut off or damaged, {name} may be lost", source=self.source)
        return name in self.entries

    def array(self, name: str, dtype: str, count: int, *, optional: bool = False) -> npt.NDArray[Any]:
        """Return an entry as a read-only array.

        Args:
            name: path inside the archive.
            dtype: little-endian numpy type, as `<u8`.
            count: how many values the index promises.
            optional: an absent entry means zeros.

        Raises:
            InputError: the entry is missing or of another size.
        """
        if optional and not self.has(name):
            return np.zeros(count, dtype=dtype)
        content = self.content(name)
        expected = count * np.dtype(dtype).itemsize
        if len(content) != expected:
            raise InputError(f"{name} has {len(content)} bytes, not {expected}", source=self.source)
        return np.frombuffer(content, dtype=dtype)

    def indices(self, name: str, count: int, *, optional: bool = False) -> npt.NDArray[np.int64]:
        """Return a uint64 entry as int64 [count]; numbers past 2^63 turn negative."""
        return self.array(name, "<u8", count, optional=optional).view("<i8")

    def numbers(self, name: str, count: int, *, optional: bool = False) -> npt.NDArray[np.int64]:
        """Return a uint32 entry as int64 [count]."""
        return self.array(name, "<u4", count, optional=optional).astype(np.int64)

    def bits(self, name: str, count: int, *, optional: bool = False) -> Bools:
        """Return a bit set, padded to a multiple of 64, as bool [count].

        Raises:
            InputError: the entry is missing, of another size, or has a bit past the last one.
        """
        packed = self.array(name, "u1", -(-count // 64) * 8, optional=optional)
        bits = np.unpackbits(packed, bitorder="little").view(np.bool_)
        if bits[count:].any():
            raise InputError(f"{name} has bits beyond the {count} that it is for", source=self.source)
        return bits[:count]

    def reals(self, name: str, kind: ValueType, count: int, *, optional: bool = False) -> Floats:
        """Return doubles, or rationals as the nearest doubles; float64 [count].

        Raises:
            InputError: the entry is missing, of another size or type, or a rational is no number.
        """
        if not kind.is_real:
            raise InputError(f"{name} is of type {kind.type}, not double or rational", source=self.source)
        if kind.type != "rational" or (optional and not self.has(name)):
            return self.array(name, "<f8", count, optional=optional)
        width = kind.size // 8
        content = self.content(name)
        if len(content) != count * width:
            raise InputError(
                f"{name} has {len(content)} bytes, not {count * width}: by the index these are rationals "
                f"of {width} bytes; numbers must be of type double or rational",
                source=self.source,
            )
        distinct, place = np.unique(np.frombuffer(content, f"V{width}"), return_inverse=True)
        try:
            values = [_quotient(bytes(number)) for number in distinct]
        except (ZeroDivisionError, OverflowError) as error:
            raise InputError(f"{name} has a value that is no number ({error})", source=self.source) from error
        rounded: Floats = np.array(values, dtype=np.float64)[place]
        return rounded

    def content(self, name: str) -> memoryview:
        """Return the bytes of an entry.

        Raises:
            InputError: there is no such entry.
        """
        if name not in self.entries:
            raise InputError(f"{name} is missing in the archive", source=self.source)
        return self.entries[name]


def _quotient(number: bytes) -> float:
    """Divide the signed first half by the unsigned second half."""
    half = len(number) // 2
    return int.from_bytes(number[:half], "little", signed=True) / int.from_bytes(number[half:], "little")


def open_archive(path: Path) -> Archive:
    """Map a tar file into memory; decompress it if it is compressed by gzip or xz.

    Raises:
        InputError: the file can't be read, is damaged or not a tar file.
    """
    try:
        entries, complete = _entries(_map_or_decompress(path))
        return Archive(str(path), entries, complete)
    except _DAMAGE as error:
        raise InputError(f"not a UMB archive ({error})", source=str(path)) from error
    except OSError as error:
        raise InputError(f"can't be read ({error.strerror or error})", source=str(path)) from error


def _map_or_decompress(path: Path) -> mmap.mmap | bytes:
    with path.open("rb") as file:
        magic = file.read(6)
        file.seek(0)
        if magic.startswith(_GZIP_MAGIC):
            return gzip.decompress(file.read())
        if magic == _XZ_MAGIC:
            return lzma.decompress(file.read())
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _entries(data: mmap.mmap | bytes) -> tuple[dict[str, memoryview], bool]:
    """Return the entries, and whether the block of zeros that ends a tar file follows the last."""
    view = memoryview(data)
    entries: dict[str, memoryview] = {}
    end = 0
    with tarfile.open(fileobj=io.BytesIO(data) if isinstance(data, bytes) else data, mode="r:") as tar:
        for member in tar:
            name = member.name.removeprefix("./")
            stop = member.offset_data + member.size
            if member.issparse() or member.size < 0 or stop > len(view):
                raise tarfile.ReadError(f"entry {name!r} is cut off")
            end = stop + -stop % tarfile.BLOCKSIZE
            if member.isdir():
                continue
            if not member.isreg() or name in entries:
                raise tarfile.ReadError(f"entry {name!r} is there twice or is no plain file")
            entries[name] = view[member.offset_data : stop]
    return entries, view[end : end + tarfile.BLOCKSIZE] == bytes(tarfile.BLOCKSIZE)


def write_archive(path: Path, entries: Mapping[str, bytes | npt.NDArray[Any]], *, overwrite: bool) -> None:
    """Write an uncompressed tar file; the same entries give the same bytes.

    The file appears complete or not at all, and a model that is mapped from an older file
    of this name keeps that one.

    Raises:
        OutputError: the file is there and must not be overwritten, or can't be written.
    """
    if path.exists() and not overwrite:
        raise OutputError(f"{path} is already there")
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            for name, content in entries.items():
                _write_entry(file, name, content)
            file.write(bytes(2 * tarfile.BLOCKSIZE))
        draft.replace(path)
    except OSError as error:
        raise OutputError(f"{path} can't be written ({error.strerror or error})") from error
    finally:
        draft.unlink(missing_ok=True)


def _write_entry(file: io.BufferedWriter, name: str, content: bytes | npt.NDArray[Any]) -> None:
    data = content.data if isinstance(content, np.ndarray) else memoryview(content)
    header = tarfile.TarInfo(name)
    header.size = data.nbytes
    file.write(header.tobuf(format=tarfile.PAX_FORMAT))
    file.write(data)
    file.write(bytes(-data.nbytes % tarfile.BLOCKSIZE))
