"""Pictures as files: PNG and SVG, the same bytes for the same picture."""

from __future__ import annotations

from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from merap.concerns.arguments import as_path
from merap.errors import OutputError
from merap.families.folder import write_bytes

# Without a date and the version of a library, so that the same picture gives the same bytes.
_METADATA: dict[str, dict[str, str | None]] = {
    ".png": {"Software": "merap"},
    ".svg": {"Creator": "merap", "Date": None},
}
FORMATS = tuple(_METADATA)
DOTS_PER_INCH = 160

# The ids of elements in SVG come from the salt; without it they are random.
_SETTINGS: dict[Any, Any] = {"svg.hashsalt": "merap", "svg.fonttype": "path"}


def save_figure(figure: Figure, path: str | PathLike[str], *, force: bool = False) -> tuple[Path, ...]:
    """Write a picture whole or not at all; return the files written.

    Args:
        figure: the picture.
        path: ends in `.png` or `.svg`; with neither, both are written. A combination's name,
            which has dots, counts as neither.
        force: replace a file that is there.

    Raises:
        OutputError: another picture format; a file exists and `force` is not set; or it can't
            be written.
    """
    files = _files(as_path(path, "path"))
    for file in files:
        if file.exists() and not force:
            raise OutputError(f"{file}: exists already; choose another name or remove it")
    for file in files:
        write_bytes(file, figure_bytes(figure, file.suffix.lower()), force=True)
    return files


def figure_bytes(figure: Figure, suffix: str) -> bytes:
    """Return the file of a picture; `suffix` is one of `FORMATS`."""
    stream = BytesIO()
    with mpl.rc_context(_SETTINGS):
        figure.savefig(stream, format=suffix[1:], dpi=DOTS_PER_INCH, metadata=_METADATA[suffix])
    return stream.getvalue()


def _files(path: Path) -> tuple[Path, ...]:
    suffix = path.suffix.lower()
    if suffix in FORMATS:
        return (path,)
    if suffix[1:] in FigureCanvasAgg.filetypes:
        raise OutputError(f"{path}: {suffix[1:]} is not offered; allowed: {', '.join(FORMATS)}")
    return tuple(path.with_name(path.name + format_) for format_ in FORMATS)
