"""A case's combinations as files: PRISM text, and UMB archives of what Storm built."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from os import PathLike
from pathlib import Path

from merap.checker.combination_model import export_combination
from merap.concerns.arguments import as_path
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.families.folder import result_folder, write_manifest
from merap.prism.rendering import render


def render_case(case: CaseStudy, combinations: Iterable[Combination], folder: str | PathLike[str]) -> int:
    """Write `<combination>.prism` for each, and `manifest.json`; return how many.

    Same input, same bytes.

    Raises:
        OutputError: `folder` holds something else, or can't be written.
    """

    def write(combination: Combination, path: Path) -> None:
        path.write_text(render(combination), encoding="utf-8")

    return _write_each(case, combinations, folder, "prism", write)


def export_case(case: CaseStudy, combinations: Iterable[Combination], folder: str | PathLike[str]) -> int:
    """Build each combination with Storm and write `<combination>.umb`; return how many.

    Raises:
        OutputError: `folder` holds something else, or can't be written.
        ModelError: a model is unsound.
    """
    return _write_each(case, combinations, folder, "umb", export_combination)


def _write_each(
    case: CaseStudy,
    combinations: Iterable[Combination],
    folder: str | PathLike[str],
    kind: str,
    write: Callable[[Combination, Path], None],
) -> int:
    with result_folder(as_path(folder, "folder"), kind) as staging:
        names = []
        for combination in combinations:
            names.append(f"{combination.name}.{kind}")
            write(combination, staging / names[-1])
        write_manifest(staging, kind, {"case": case.name, "digest": case.digest}, names)
    return len(names)
