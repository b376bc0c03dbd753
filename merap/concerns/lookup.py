"""Cases and combinations as users write them in Python: a path for a case, a name for a system."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import Any, TypeAlias

from merap.concerns.case_study import CaseStudy, DeclaredCase, load_case
from merap.concerns.combination import Combination, DeclaredCombination
from merap.concerns.schema_base import shown
from merap.errors import InputError

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


def as_combination(value: Any) -> Combination:
    """Return a combination as it is.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(value, Combination):
        raise InputError(
            f"expected a combination, such as case.combination(NAME), got {shown(value)}",
            source="combination",
        )
    return value


def declared(combination: Combination) -> DeclaredCombination:
    """Return a combination whose parts are declared in the case language.

    Raises:
        InputError: it comes from PRISM text.
    """
    if not isinstance(combination, DeclaredCombination):
        raise InputError(f"{combination.name} is PRISM text: that is possible in the case language only")
    return combination


def declared_case(case: CaseStudy) -> DeclaredCase:
    """Return a case in the case language.

    Raises:
        InputError: its models come from PRISM text.
    """
    if not isinstance(case, DeclaredCase):
        raise InputError(f"{case.name} is PRISM text: that is possible in the case language only")
    return case
