"""The grammar of expressions: PRISM's operators with PRISM's precedence, and `at(..)`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from lark import Lark

# From what binds least to sums, as PRISM has it; both grammars define what products are of.
OPERATORS = r"""
?conditional: implication | implication "?" conditional ":" conditional -> choose
?implication: equivalence | implication IMPLIES equivalence -> binary
?equivalence: disjunction | equivalence IFF disjunction -> binary
?disjunction: conjunction | disjunction OR conjunction -> binary
?conjunction: negation | conjunction AND negation -> binary
?negation: equality | NOT negation -> unary
?equality: relation | equality EQUALS relation -> binary
?relation: sum | relation ORDER sum -> binary
?sum: product | sum ADD product -> binary
"""

# A name may say whose it is, as in `environment.up`; a label stands in quotes.
# As in PRISM, operators of one level group to the left, `=>` too, and `!` binds less than `=`.
GRAMMAR = (
    "?start: conditional\n"
    + OPERATORS
    + r"""
?product: minus | product TIMES minus -> binary
?minus: atom | "-" minus -> negate
?atom: NUMBER -> number | "true" -> true | "false" -> false | (NAME | LABEL) -> variable
     | FUNCTION "(" conditional ("," conditional)* ")" -> call | AT "(" places ")" -> at
     | "(" conditional ")"
?places: place | "[" place ("," place)* "]" -> several
?place: NAME -> variable | "[" NUMBER "," NUMBER "]" -> cell
IMPLIES.2: "=>"
IFF.2: "<=>"
OR: "|"
AND: "&"
NOT: "!"
EQUALS: "=" | "!="
ORDER: "<=" | ">=" | "<" | ">"
ADD: "+" | "-"
TIMES: "*" | "/"
AT.2: /at'?(?=\s*\()/
FUNCTION.2: /(min|max|floor|ceil|pow|mod)(?=\s*\()/
NAME: /[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)?'?/
LABEL: /"[A-Za-z_][A-Za-z0-9_]*"/
NUMBER: /\d+(\.\d+)?([eE][+-]?\d{1,3})?/
%ignore /[ \t\r\n]+/
"""
)

ARITIES: Mapping[str, range] = {
    "min": range(2, 100),
    "max": range(2, 100),
    "floor": range(1, 2),
    "ceil": range(1, 2),
    "pow": range(2, 3),
    "mod": range(2, 3),
}


@lru_cache(maxsize=1)
def parser() -> Lark:
    """The parser, built once."""
    return Lark(GRAMMAR, parser="lalr", maybe_placeholders=False)
