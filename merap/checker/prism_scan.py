"""Find text in PRISM files that Storm reads wrongly or crashes on."""

from __future__ import annotations

import re

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
_MDP = ("mdp", "nondeterministic", "pomdp")


def readable_text(text: str) -> str:
    """Return text that Storm reads rightly, lines where they were: holes become undefined constants.

    A hole `hole int x in {1..3};` also defines the constants `x_MIN` and `x_MAX`, which sketches use; a
    POMDP becomes an MDP.

    Raises:
        InputError: something is not supported; names the line.
    """
    parts: list[str] = []
    last, kind = 0, None
    for found in _TOKENS.finditer(text):
        name = found.lastgroup if found.group("hole") is None else "hole"
        line = text.count("\n", 0, found.start()) + 1
        parts.append(text[last : found.start()])
        last = found.end()
        match name:
            case "comment":
                continue
            case "type" if kind is None:
                kind = found.group()
                if kind not in _MDP:
                    raise InputError(f"the model is of type {kind}, only mdp is supported", line=line)
                parts.append("mdp")
            case "hole":
                parts.append(_constant(found))
            case "quoted" | "type":
                parts.append(found.group())
            case "observed":
                raise InputError("observables are not supported: states are seen whole", line=line)
            case _:
                assert name is not None
                raise InputError(_REFUSED[name], line=line)
    if kind is None:
        raise InputError("the type of the model is missing: write mdp in the first line", line=1)
    return "".join([*parts, text[last:]])


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
