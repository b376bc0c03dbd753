"""The tar file around a UMB model: entries as views into the file, written in one pass."""

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
from merap.mdp.model import Bools

_GZIP_MAGIC = b"\x1f\x8b\x08"
_XZ_MAGIC = b"\xfd7zXZ\x00"
_DAMAGE = (tarfile.TarError, zlib.error, lzma.LZMAError, gzip.BadGzipFile, EOFError, ValueError)


@dataclass(frozen=True)
class Archive:
    """The entries of an archive, without copies.

    Attributes:
        source: the file, for messages.
        entries: name -> bytes; they keep the mapped file alive.
    """

    source: str
    entries: Mapping[str, memoryview]

    def array(self, name: str, dtype: str, count: int) -> npt.NDArray[Any]:
        """An entry as a read-only array.

        Args:
            name: path inside the archive.
            dtype: little-endian numpy type, as `<u8`.
            count: how many values the index promises.

        Raises:
            InputError: the entry is missing or of another size.
        """
        content = self.content(name)
        expected = count * np.dtype(dtype).itemsize
        if len(content) != expected:
            raise InputError(f"{name} has {len(content)} bytes, not {expected}", source=self.source)
        return np.frombuffer(content, dtype=dtype)

    def indices(self, name: str, count: int) -> npt.NDArray[np.int64]:
        """A uint64 entry seen as int64, so that what is past 2^63 shows as negative."""
        return self.array(name, "<u8", count).view("<i8")

    def bits(self, name: str, count: int) -> Bools:
        """A bit set, padded to a multiple of 64, as bool [count].

        Raises:
            InputError: the entry is missing or of another size.
        """
        packed = self.array(name, "u1", -(-count // 64) * 8)
        return np.unpackbits(packed, count=count, bitorder="little").view(np.bool_)

    def content(self, name: str) -> memoryview:
        """The bytes of an entry.

        Raises:
            InputError: there is no such entry.
        """
        if name not in self.entries:
            raise InputError(f"{name} is missing in the archive", source=self.source)
        return self.entries[name]


def open_archive(path: Path) -> Archive:
    """Maps a tar file into memory; one compressed by gzip or xz is decompressed instead.

    Raises:
        InputError: the file can't be read, is damaged or not a tar file.
    """
    try:
        data = _map_or_decompress(path)
        return Archive(str(path), _entries(data))
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


def _entries(data: mmap.mmap | bytes) -> dict[str, memoryview]:
    view = memoryview(data)
    entries: dict[str, memoryview] = {}
    with tarfile.open(fileobj=io.BytesIO(data) if isinstance(data, bytes) else data, mode="r:") as tar:
        for member in tar:
            if not member.isreg():
                continue
            end = member.offset_data + member.size
            if member.issparse() or member.size < 0 or end > len(view):
                raise tarfile.ReadError(f"entry {member.name!r} is cut off")
            entries[member.name.removeprefix("./")] = view[member.offset_data : end]
    return entries


def write_archive(path: Path, entries: Mapping[str, bytes | npt.NDArray[Any]], *, overwrite: bool) -> None:
    """Writes an uncompressed tar file; the same entries give the same bytes.

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
