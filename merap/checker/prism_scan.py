"""Find text in PRISM files that Storm reads wrongly or crashes on."""

from __future__ import annotations

import re
from collections.abc import Mapping

from merap.errors import InputError

# Comments, quoted names, and what is to be found; the first that matches at a place counts.
_TOKENS = re.compile(
    r"""(?P<comment>//[^\n]*)
    |(?P<quoted>"[^"\n]*")
    |(?P<system>\bsystem\b)
    |(?P<observed>\bobservables?\b)
    |(?P<clock>:\s*clock\b|\binvariant\b)
    |(?P<unbounded>\b\w+\s*:\s*int\b)
    |(?P<interval>(?:->|\+)\s*\[[^\]\n]*,[^\]\n]*\]\s*:)
    |(?P<type>\b(?:dtmc|ctmc|mdp|pta|pomdp|popta|smg|csg|tsg|imdp|idtmc|ma|probabilistic|stochastic|nondeterministic)\b)
    |(?P<hole>\bhole\s+(?P<kind>int|bool|double)\s+(?P<name>\w+)\s+in\s*\{(?P<values>[^}]*)\}\s*;)
    """,
    re.VERBOSE,
)
_REFUSED = {
    "system": "a `system ... endsystem` block is not supported: modules run in full synchronisation",
    "clock": "clocks are not supported",
    "unbounded": "a variable without bounds is not supported: give it a range, as `x : [0..10]`",
    "interval": "interval probabilities are not supported here",
}
MDP: Mapping[str, str] = {"mdp": "mdp", "nondeterministic": "mdp", "pomdp": "mdp"}
KINDS: Mapping[str, str] = {
    "mdp": "mdp",
    "nondeterministic": "mdp",
    "dtmc": "dtmc",
    "probabilistic": "dtmc",
}


def readable_text(text: str, kinds: Mapping[str, str] = MDP) -> str:
    """Return text that Storm reads rightly, lines where they were: holes become undefined constants.

    A hole `hole int x in {1..3};` also defines the constants `x_MIN` and `x_MAX`, which sketches use; a
    POMDP becomes an MDP.

    Args:
        text: of the model.
        kinds: kinds of models that are read, as text names them and as Storm does; with `KINDS` the text
            is for Storm's builder, where variables need no bounds and the kind may be missing.

    Raises:
        InputError: something is not supported; names the line.
    """
    parts: list[str] = []
    last, kind = 0, None
    for found in _TOKENS.finditer(text):
        name = found.lastgroup if found.group("hole") is None else "hole"
        if name == "unbounded" and kinds is KINDS:
            name = "quoted"  # as it is
        line = text.count("\n", 0, found.start()) + 1
        parts.append(text[last : found.start()])
        last = found.end()
        match name:
            case "comment":
                continue
            case "type" if kind is None:
                kind = found.group()
                parts.append(_kind(kind, kinds, line))
            case "hole":
                parts.append(_constant(found))
            case "quoted" | "type":
                parts.append(found.group())
            case "observed":
                raise InputError("observables are not supported: states are seen whole", line=line)
            case _:
                assert name is not None
                raise InputError(_REFUSED[name], line=line)
    if kind is None and kinds is not KINDS:
        raise InputError("the type of the model is missing: write mdp in the first line", line=1)
    return "".join(["mdp " if kind is None else "", *parts, text[last:]])


def _kind(kind: str, kinds: Mapping[str, str], line: int) -> str:
    if kind not in kinds:
        allowed = " or ".join(sorted(set(kinds.values())))
        raise InputError(f"the model is of type {kind}, only {allowed} is supported", line=line)
    return kinds[kind]


def _constant(hole: re.Match[str]) -> str:
    name, kind = hole.group("name"), hole.group("kind")
    text = f"const {kind} {name};"
    values = re.fullmatch(r"\s*(-?\d+)\s*\.\.\s*(-?\d+)\s*(?::\s*\d+\s*)?", hole.group("values"))
    listed = [part.strip() for part in hole.group("values").split(",")]
    if kind == "int" and values:
        text += f" const int {name}_MIN = {values[1]}; const int {name}_MAX = {values[2]};"
    elif kind == "int" and all(re.fullmatch(r"-?\d+", part) for part in listed):
        numbers = sorted(map(int, listed))
        text += f" const int {name}_MIN = {numbers[0]}; const int {name}_MAX = {numbers[-1]};"
    return text + "\n" * hole.group().count("\n")
