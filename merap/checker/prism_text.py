"""Prepare PRISM text of other people for Storm, so that it checks the model that PRISM means.

Lines stay where they were, for messages.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from merap.checker.prism_model import ConstantType
from merap.checker.prism_scan import KINDS, readable_text
from merap.program.names import unique_name

_CONSTANT = re.compile(r"\bconst\s+(?:(int|double|bool|rate|prob)\s+)?(\w+)\s*(;|=)")
_TYPES: Mapping[str, ConstantType | None] = {
    "": None,
    "int": "int",
    "bool": "bool",
    "double": "double",
    "rate": "double",
    "prob": "double",
}
_UNNAMED = re.compile(r"\brewards\b(?!\s*\")")
_MODULO = re.compile(r"\bmod\s*\(")
_OPERAND = r"[^;&|?:,\[\]{}<>=!']*"
_DEFINED = re.compile(r"^\s*(formula|label)\b[^=]*=")
_COMPARISON = re.compile(rf"({_OPERAND})(?:<=|>=|<|>|!=|(?<!')=)({_OPERAND})")
_DECIMAL, _ARITHMETIC = re.compile(r"\d\.\d"), re.compile(r"[-+*/]")


@dataclass(frozen=True)
class CheckableText:
    """A text that Storm reads as PRISM does.

    Attributes:
        text: of the model.
        constants: its open constants; None where no type is stated, which means int.
        warnings: what is probably not meant, with lines.
    """

    text: str
    constants: Mapping[str, ConstantType | None]
    warnings: tuple[str, ...]


def checkable_text(text: str) -> CheckableText:
    """Prepare the text of a Markov chain or an MDP.

    Reward structures without a name get one, since Storm has no way to name them; `mod` becomes floor
    arithmetic, since Storm's is wrong for negative numbers; PAYNT's holes become open constants.

    Raises:
        InputError: the model is of another kind, or uses what Storm reads wrongly; names the line.
    """
    text = _without_comments(text)
    warnings = tuple(_compared_decimals(text))
    text = readable_text(text, KINDS)
    names = set(re.findall(r"\w+", text))
    while (found := _UNNAMED.search(text)) is not None:
        name = unique_name("rewards", names)
        names.add(name)
        text = f'{text[: found.end()]} "{name}"{text[found.end() :]}'
    open_constants = {name: _TYPES[kind] for kind, name, end in _CONSTANT.findall(text) if end == ";"}
    return CheckableText(_floor_modulo(text), open_constants, warnings)


def _without_comments(text: str) -> str:
    return re.sub(r"//[^\n]*", "", text)


def _floor_modulo(text: str) -> str:
    """Write mod(a, b) as a - b * floor(a / b), the innermost one first."""
    while (found := list(_MODULO.finditer(text))) != []:
        start, first = found[-1].span()
        depth, comma, end = 1, first, first
        while depth and end < len(text):
            depth += (text[end] == "(") - (text[end] == ")")
            if text[end] == "," and depth == 1:
                comma = end
            end += 1
        left, right = text[first:comma], text[comma + 1 : end - 1]
        text = f"{text[:start]}(({left})-({right})*floor(({left})/({right}))){text[end:]}"
    return text


def _compared_decimals(text: str) -> Iterator[str]:
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("const"):
            continue
        for found in _COMPARISON.finditer(_DEFINED.sub("", line)):
            if _DECIMAL.search(found.group()) and any(map(_ARITHMETIC.search, found.groups())):
                compared = " ".join(found.group().split())
                yield (
                    f"line {number}: {compared} compares decimals, which engines decide on rounded numbers; "
                    "whole numbers are exact"
                )
