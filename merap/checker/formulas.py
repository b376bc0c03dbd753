"""Decide from a property's text, as Storm prints it, which operators stand where.

stormpy gives no access to the two sides of `&` and `|`, nor to what stands in a quantile, so a
property is read from Storm's own normal form. There an operator is `P>=1/2 [..]`, with one space
before its bracket and none before the bracket of an interval; names stand in quotes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

OPENING = " ["
_NAME = re.compile(r'"[^"]*"')
_OTHER_LOGIC = re.compile(r"(?<!\w)(?P<kind>multi|quantile)\(|(?P<game><<)")
_REWARD_OPERATOR = re.compile(
    r'(?<![\w"])R(?:\{"(?P<structure>[^"]*)"\})?(?:min|max)?(?:=\?|[<>][^\[]*) \['
    r"(?P<bounded>C<|Cdiscount=|I=)?"
)


def count_operators(text: str) -> int:
    """Return how many operators (P, R, T, LRA) a property has, at its root and below."""
    return text.count(OPENING)


def count_queries(text: str) -> int:
    """Return how many of the operators of a property ask for a value, as `Pmax=? [..]`."""
    return text.count("=?" + OPENING)


def unbounded_rewards(text: str) -> Iterator[str | None]:
    """Yield the reward structure of each operator that sums up rewards without end.

    Rewards over a bounded number of steps, discounted rewards and the reward of one step are no
    such sums. None stands for the only structure of the model.
    """
    for operator in _REWARD_OPERATOR.finditer(text):
        if not operator["bounded"]:
            yield operator["structure"]


def other_logic(text: str) -> str | None:
    """Return the logic of a property beyond single values: `multi(..)`, `quantile(..)` or `<<..>>`."""
    found = _OTHER_LOGIC.search(_NAME.sub('""', text))
    if found is None:
        return None
    return "<<..>>" if found["game"] else f"{found['kind']}(..)"
