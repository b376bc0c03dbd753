"""Write path formulas over labels in Storm's language, and rewrite the forms that it lacks.

`G<=k a` is the complement of `F<=k !a`, `a W b` that of `(a & !b) U (!a & !b)`, `a R b` that of `!a U !b`.
`a U>=k b` asks for k steps within `a` first and then for `a U b`; the steps are left to the caller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from lark import Token, Tree

from merap.checker.property_file import Node
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.errors import InputError

_TEMPORAL_TEXTS = {
    "X": "(X {0})",
    "F": "(F {0})",
    "G": "(G {0})",
    "U": "({0} U {1})",
    "W": "(!(({0} & (!{1})) U ((!{0}) & (!{1}))))",
    "R": "(!((!{0}) U (!{1})))",
}
# Return the name of a label for a state formula, and compute a whole number.
Label: TypeAlias = Callable[[Node], str]
Steps: TypeAlias = Callable[[Node], int]

_TEMPORAL = frozenset(("binary_path", "unary_path"))
_CONNECTIVES = frozenset(("binary", "unary", "brackets", "choose"))
_CONNECTED = {
    "&": "({0} & {1})",
    "|": "({0} | {1})",
    "=>": "((!{0}) | {1})",
    "<=>": "(({0} & {1}) | ((!{0}) & (!{1})))",
    "=": "(({0} & {1}) | ((!{0}) & (!{1})))",
    "!=": "(({0} & (!{1})) | ((!{0}) & {1}))",
}


@dataclass(frozen=True)
class PathText:
    """A path formula in Storm's language.

    Attributes:
        text: over labels in quotes.
        complement: its probability is 1 minus that of the text.
        delay: steps to take before the text counts.
        stay: label of the states to be in while these are taken.
        nested: whether the text has path formulas inside others.
    """

    text: str
    complement: bool = False
    delay: int = 0
    stay: str | None = None
    nested: bool = False


def is_path(tree: Node) -> bool:
    """Return whether a formula speaks of a path by itself, not within an operator."""
    if tree.data in _TEMPORAL:
        return True
    return tree.data in _CONNECTIVES and any(
        is_path(part) for part in tree.children if isinstance(part, Tree)
    )


def path_text(tree: Node, label: Label, steps: Steps) -> PathText:
    """Write the path formula of an operator.

    Raises:
        UnsupportedPropertyError: neither Storm nor a rewriting has it; names the form.
    """
    while tree.data == "brackets":
        tree = tree.children[0]
    writer = _Writer(label, steps)
    if tree.data == "unary" and is_path(tree):
        inner = path_text(tree.children[1], label, steps)
        return replace(inner, complement=not inner.complement)
    if tree.data in _TEMPORAL and not any(map(is_path, _operands(tree))):
        return writer.step_formula(tree)
    if not is_path(tree):
        return PathText(f"{writer.text(tree)} U {writer.text(tree)}")
    return PathText(writer.text(tree), nested=True)


def _operands(tree: Node) -> list[Node]:
    return [tree.children[-1]] if tree.data == "unary_path" else [tree.children[0], tree.children[-1]]


class _Writer:
    def __init__(self, label: Label, steps: Steps) -> None:
        self._label, self._steps = label, steps

    def step_formula(self, tree: Node) -> PathText:
        """Write one temporal operator over states."""
        if tree.data == "unary_path":
            symbol, bounds, target = tree.children
            if symbol == "X":
                if bounds is not None:
                    raise InputError("X takes no bound on time")
                return PathText(f"X {self.text(target)}")
            if symbol == "G":
                return replace(self._until("true", bounds, self._negated(target)), complement=True)
            return self._until("true", bounds, self.text(target))
        left, symbol, bounds, right = tree.children
        if symbol == "U":
            return self._until(self.text(left), bounds, self.text(right), stay=left)
        not_left, not_right = self._negated(left), self._negated(right)
        first = f"({self.text(left)} & {not_right})" if symbol == "W" else not_left
        last = f"({not_left} & {not_right})" if symbol == "W" else not_right
        stay = _both(left, _not(right)) if symbol == "W" else _not(left)
        return replace(self._until(first, bounds, last, stay=stay), complement=True)

    def _until(self, left: str, bounds: Node | None, right: str, stay: Node | None = None) -> PathText:
        least, most = self._interval(bounds)
        until = f"{left} U{'' if most is None else f'<={most}'} {right}"
        if least == 0:
            return PathText(until)
        if most is None:
            return PathText(until, delay=least, stay=None if stay is None else self._label(stay))
        return PathText(f"{left} U[{least},{most}] {right}")

    def _interval(self, bounds: Node | None) -> tuple[int, int | None]:
        """Return the least and the greatest number of steps; None without end."""
        if bounds is None:
            return 0, None
        most: int | None
        if bounds.data == "interval":
            least, most = map(self._steps, bounds.children)
        else:
            symbol, count = bounds.children
            number, is_lower = self._steps(count), str(symbol).startswith(">")
            least = number + (symbol == ">") if is_lower or symbol == "=" else 0
            most = None if is_lower else number - (symbol == "<")
        if least < 0 or (most is not None and most < least):
            raise InputError("a bound on time leaves no step: expected 0 or more, the least one first")
        return least, most

    def text(self, tree: Node) -> str:
        """Write a formula, temporal or not, in brackets."""
        if not is_path(tree):
            return f'"{self._label(tree)}"'
        children = tree.children
        match tree.data:
            case "brackets":
                return self.text(children[0])
            case "unary":
                return self._negated(children[1])
            case "choose":
                condition, taken, other = map(self.text, children)
                return f"(({condition} & {taken}) | ((!{condition}) & {other}))"
            case "binary":
                return _CONNECTED[str(children[1])].format(self.text(children[0]), self.text(children[2]))
        return self._nested(tree)

    def _nested(self, tree: Node) -> str:
        if any(map(is_path, _operands(tree))):
            return self._around_paths(tree)
        written = self.step_formula(tree)
        if written.delay:
            raise UnsupportedPropertyError("a lower bound on time alone inside another path formula")
        return f"(!({written.text}))" if written.complement else f"({written.text})"

    def _around_paths(self, tree: Node) -> str:
        *left, symbol, bounds, right = tree.children
        if bounds is not None:
            raise UnsupportedPropertyError("a bound on time around another path formula")
        written = [self.text(one) for one in (*left, right)]
        return _TEMPORAL_TEXTS[str(symbol)].format(*written)

    def _negated(self, tree: Node) -> str:
        return f"(!{self.text(tree)})"


def _not(tree: Node) -> Node:
    return Tree("unary", [Token("NOT", "!"), tree])


def _both(left: Node, right: Node) -> Node:
    return Tree("binary", [left, Token("AND", "&"), right])
