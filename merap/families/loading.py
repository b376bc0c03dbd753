"""Load a case of either kind: in the case language, or as PRISM text."""

from __future__ import annotations

from os import PathLike

from merap.concerns.arguments import as_path
from merap.concerns.case_study import CaseStudy, load_declared_case
from merap.concerns.loading import read_document_of
from merap.families.prism_family_loading import load_written


def load_case(path: str | PathLike[str]) -> CaseStudy:
    """Load a case file, or `case.yaml` of a folder.

    Raises:
        InputError: one clear line with file, line and key.
        EngineError: Storm crashed on the PRISM text of a case.
    """
    file, document = read_document_of(as_path(path, "case"))
    if "program" in document.data:
        return load_written(file, document)
    return load_declared_case(file)
