"""Cases and combinations as users write them in Python: a path for a case, a name for a system."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import TypeAlias

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.concerns.lookup import as_combination
from merap.concerns.schema_base import shown
from merap.errors import InputError
from merap.families.loading import load_case

Combinations: TypeAlias = CaseStudy | Combination | str | PathLike[str] | Iterable[Combination]


def as_case(value: CaseStudy | str | PathLike[str]) -> CaseStudy:
    """Return a case, loaded if its path is given.

    Raises:
        InputError: it is neither, or the case file is wrong.
    """
    if isinstance(value, CaseStudy):
        return value
    if not isinstance(value, str | PathLike):
        raise InputError(f"expected a case or the path of one, got {shown(value)}", source="case")
    return load_case(value)


def as_system(case: CaseStudy, value: Combination | str) -> Combination:
    """Return an online system or a combination of a case, looked up if its name is given.

    Raises:
        InputError: it is neither, the case has none of that name, or the combination is of another case.
    """
    if isinstance(value, Combination):
        if value.digest != case.digest:
            raise InputError(f"{value.name} is of another case than {case.name}", source="system")
        return value
    if not isinstance(value, str):
        raise InputError(
            f"expected a combination, or the name of one or of an online system, got {shown(value)}",
            source="system",
        )
    return case.system(value)


def as_combinations(value: Combinations) -> Iterable[Combination]:
    """Return combinations: those of a case or of its path, a single one, or several.

    Raises:
        InputError: it is none of that, or a case has too many to enumerate.
    """
    if isinstance(value, Combination):
        return (value,)
    if isinstance(value, CaseStudy | str | PathLike):
        return as_case(value).combinations()
    if not isinstance(value, Iterable):
        raise InputError(f"expected a case or combinations, got {shown(value)}", source="combinations")
    return map(as_combination, value)
