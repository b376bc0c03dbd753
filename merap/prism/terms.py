"""Terms of PRISM expressions: what they mean together, and the parentheses they need.

A term is `true`, `false`, a name, a number, a comparison, or in parentheses.
"""

from __future__ import annotations

from itertools import accumulate


def bare(text: str) -> str:
    """`text` without parentheses around the whole."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depths = list(accumulate((char == "(") - (char == ")") for char in text))
    return text[1:-1] if 0 not in depths[:-1] else text


def condition_of(text: str) -> str:
    """`text` as the condition of a `?:`, where another `?:` needs its parentheses."""
    return text if "?" in text else bare(text)


def alternatives(terms: list[str]) -> str:
    """Join `terms` by or: `false`, an atom, or in parentheses."""
    if len(terms) <= 1:
        return terms[0] if terms else "false"
    return f"({' | '.join(terms)})"


def conjunction(terms: list[str]) -> str:
    """Join `terms` by and: `true`, `false`, an atom, or in parentheses."""
    if "false" in terms:
        return "false"
    real = [term for term in terms if term != "true"]
    if len(real) <= 1:
        return real[0] if real else "true"
    return f"({' & '.join(real)})"
