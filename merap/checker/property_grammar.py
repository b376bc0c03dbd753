"""The grammar of PRISM's property files: constants, labels, and properties with a name or without."""

from __future__ import annotations

from functools import lru_cache

from lark import Lark

from merap.program.expressions.grammar import OPERATORS

# As in PRISM's own grammar, `F a | b` is F of (a | b), and `a U b` binds least of all. Beside PRISM's
# language, Storm's `LRA`, `T` and `C<=kdiscount=d` are read.
GRAMMAR = (
    OPERATORS
    + r"""
start: (constant | label | property | ";")*
constant: "const" [TYPE] NAME ["=" formula] ";"
label: "label" NAME_OR_LABEL "=" formula ";"
property: [LABEL ":"] formula
?formula: path
?path: temporal | temporal UNTIL [bounds] temporal -> binary_path
?temporal: conditional | NEXT [bounds] temporal -> unary_path
?product: power | product TIMES power -> binary
?power: minus | minus "^" power -> power
?minus: atom | "-" minus -> minus
?atom: NUMBER -> number | TRUTH -> truth | NAME -> name | LABEL -> label_name
     | FUNCTION "(" formula ("," formula)* ")" -> call
     | "(" formula ")" -> brackets
     | PROBABILITY [DIRECTION] condition "[" formula old_filter* "]" -> probability
     | LONG_RUN [DIRECTION] condition "[" formula old_filter* "]" -> long_run
     | _reward_letter [structure] [DIRECTION] condition "[" reward_path old_filter* "]" -> reward
     | QUANTIFIER "[" formula "]" -> quantified
     | "filter" "(" OPERATOR "," formula ["," formula] ")" -> filter
     | "multi" "(" formula ("," formula)* ")" -> multi
     | coalition atom -> strategy
_reward_letter: REWARD | REWARD_BOUND
structure: "{" (LABEL | NUMBER) "}"
coalition: (ABLE | UNABLE) [EVERYONE | PLAYER ("," PLAYER)*] (">>" | "]]")
condition: "=" "?" -> query
     | ORDER sum -> threshold
old_filter: "{" formula "}" | "{" EXTREME "}"
?reward_path: CUMULATIVE [steps] [discount] -> cumulative
     | "I" "=" sum -> instantaneous
     | ("S" | "LRA") -> long_run_reward
     | formula
steps: STEP_ORDER sum
discount: "discount" "=" sum
bounds: STEP_ORDER sum -> one_bound
     | "[" sum "," sum "]" -> interval
ABLE.5: "<<"
UNABLE.5: "[["
TYPE.3: /(int|double|bool)\b/
UNTIL.3: /[UW]\b|R(?=\s*([<>]|=\s*[\w(]|\[|\w|"|!|\())/
NEXT.2: /[XFG]\b/
IMPLIES.2: "=>"
IFF.3: "<=>"
OR: "|"
AND: "&"
NOT: "!"
EQUALS: "=" | "!="
ORDER: "<=" | ">=" | "<" | ">"
STEP_ORDER: "<=" | ">=" | "<" | ">" | "="
ADD.2: "+" | "-"
TIMES: "*" | "/"
PROBABILITY.2: /P(?=max|min|\s*[<>=])/
LONG_RUN.2: /(S|LRA)(?=max|min|\s*[<>=])/
CUMULATIVE.4: /C(?=\s*[<>\]=]|discount)/
REWARD.4: /[RT](?=max|min|\s*\{|\s*=\s*\?)/
REWARD_BOUND.2: /[RT](?=\s*[<>])/
DIRECTION.2: /(min|max)(?=\s*[<>=])/
EXTREME.3: /(min|max)(?=\s*\})/
QUANTIFIER.2: /[EA](?=\s*\[)/
OPERATOR.5: /([a-z]+|[+&|])(?=\s*,)/
FUNCTION.2: /(min|max|floor|ceil|round|pow|mod|log)(?=\s*\()/
TRUTH.2: /(true|false)\b/
EVERYONE: "*"
PLAYER: /[A-Za-z0-9_]+/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
LABEL: /"[A-Za-z_][A-Za-z0-9_ ]*"/
NAME_OR_LABEL: LABEL
NUMBER: /\d+(\.\d+)?([eE][+-]?\d{1,3})?/
%ignore /[ \t\r\n]+/
%ignore /\/\/[^\n]*/
"""
)


@lru_cache(maxsize=1)
def parser() -> Lark:
    """The parser, built once."""
    return Lark(GRAMMAR, parser="lalr", maybe_placeholders=True, propagate_positions=True)
