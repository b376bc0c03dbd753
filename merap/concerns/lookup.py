"""Narrow what a caller gives to a combination, or to the case language."""

from __future__ import annotations

from typing import Any

from merap.concerns.case_study import CaseStudy, DeclaredCase
from merap.concerns.combination import Combination, DeclaredCombination
from merap.concerns.schema_base import shown
from merap.errors import InputError


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
