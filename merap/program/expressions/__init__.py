"""Expressions in PRISM's syntax: parse, check, fold, evaluate, render.

Variables are those of the state and, with a prime, of the successor (`light'`); constants are put in by
`fold`. Numbers are exact fractions.
"""

from merap.program.expressions.building import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    all_of,
    any_of,
    negation,
    none_of,
    number,
    product_of,
)
from merap.program.expressions.columns import (
    Column,
    Columns,
    Combinations,
    Integers,
    Levels,
    Scope,
    Value,
    exact,
)
from merap.program.expressions.folding import fold
from merap.program.expressions.grammar import ARITIES
from merap.program.expressions.parsing import check, parse
from merap.program.expressions.text import render, render_constant
from merap.program.expressions.tree import (
    IN,
    Constant,
    Constants,
    Expression,
    Kind,
    Lookup,
    Operation,
    Table,
    Variable,
    parts,
    substitute,
    variables,
    with_parts,
)
from merap.program.expressions.values import (
    evaluate,
    evaluate_where_defined,
    evaluate_whole,
    tabulate,
)

__all__ = [
    "ARITIES",
    "FALSE",
    "IN",
    "ONE",
    "TRUE",
    "ZERO",
    "Column",
    "Columns",
    "Combinations",
    "Constant",
    "Constants",
    "Expression",
    "Integers",
    "Kind",
    "Levels",
    "Lookup",
    "Operation",
    "Scope",
    "Table",
    "Value",
    "Variable",
    "all_of",
    "any_of",
    "check",
    "evaluate",
    "evaluate_where_defined",
    "evaluate_whole",
    "exact",
    "fold",
    "negation",
    "none_of",
    "number",
    "parse",
    "parts",
    "product_of",
    "render",
    "render_constant",
    "substitute",
    "tabulate",
    "variables",
    "with_parts",
]
