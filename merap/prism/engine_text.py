"""Write the expressions of a program for engines, with formulas for what is long or has a name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from merap.errors import InputError
from merap.prism.engine_form import engine_form, is_table
from merap.prism.exact_form import exact_truth, exact_whole, rounded_number
from merap.prism.lines import Formula
from merap.prism.location_tree import location_tree
from merap.prism.value_tables import Domains, table_of
from merap.program.expressions import (
    Constant,
    Expression,
    Lookup,
    Operation,
    Variable,
    parts,
    render,
    with_parts,
)
from merap.program.form import Program
from merap.program.names import KEYWORDS

MAX_COMMENT = 100
# A table without a name is written in place, not as a formula, if its text is not longer.
MAX_INLINE = 48
# A comparison of two names or numbers, which reads best without spaces: mode=2.
_COMPARISON = re.compile(
    r"(?<![-+*/<=] )(?<![^=]> )\b([A-Za-z_]\w*) (!=|<=|>=|=|<|>) (-?\w+)\b(?!/| [-+*/<>=!])"
)


class EngineText:
    """Writes expressions, and remembers the formulas that they need.

    Attributes:
        domains: the variables of the program.
    """

    def __init__(self, program: Program) -> None:
        self.domains = Domains({one.name: one for one in program.variables}, program.location)
        self._definitions = {engine_form(value): name for name, value in program.definitions.items()}
        self._named: dict[Expression, Expression] = {}
        self._tables: dict[Expression, Expression] = {}
        self._formulas: dict[str, Formula] = {}
        self._shown = self._numbered = 0
        self._taken = {
            *KEYWORDS,
            *self.domains.variables,
            *program.actions,
            *program.labels,
            *program.rewards,
            *filter(None, (structure.shift for structure in program.rewards.values())),
            *(process.name for process in program.processes),
        }

    def take(self) -> list[Formula]:
        """Return the formulas that were needed and not taken before."""
        fresh = list(self._formulas.values())[self._shown :]
        self._shown = len(self._formulas)
        return fresh

    def truth(self, condition: Expression) -> str:
        """Write a condition, to be decided exactly."""
        return text_of(self.truth_form(condition))

    def truth_form(self, condition: Expression) -> Expression:
        """Return a condition that engines decide exactly."""
        return exact_truth(engine_form(condition), self)

    def whole(self, number: Expression) -> str:
        """Write a whole number, to be computed exactly."""
        return text_of(exact_whole(engine_form(number), self))

    def number_form(self, number: Expression) -> Expression:
        """Return a number that engines compute up to one rounding."""
        return rounded_number(engine_form(number), self)

    def probability_form(self, probability: Expression) -> Expression:
        """Return a probability as one of the fractions that it can be: engines add and subtract none."""
        form = engine_form(probability)
        return self._cases(form) if is_table(form) else self.table(form)

    def _cases(self, form: Expression) -> Expression:
        if not isinstance(form, Operation):
            return form
        condition, *sides = form.arguments
        return Operation("?:", (exact_truth(condition, self), *map(self._cases, sides)))

    def location_in(self, places: Sequence[Mapping[str, int]]) -> Expression:
        """Return whether the location variables have one of some joint values."""
        variables = [self.domains[name] for name in self.domains.location]
        inside = np.zeros([one.size for one in variables], dtype=np.int64)
        for place in places:
            inside[tuple(place[one.name] - one.low for one in variables)] = 1
        window = inside.reshape((1, -1)) if inside.ndim == 1 else inside
        lows, leaves = [one.low for one in variables], (Constant(False), Constant(True))
        return location_tree(self.domains.location, lows, window, leaves)

    def formula(self, name: str, form: Expression, meaning: str = "") -> Expression:
        """Give a form a name, unless it is a name or constant itself."""
        if isinstance(form, Constant | Variable):
            return form
        text = text_of(form)
        while name in self._taken and (name not in self._formulas or self._formulas[name].text != text):
            name += "_"
        self._taken.add(name)
        self._formulas.setdefault(name, Formula(name, text, meaning))
        return Variable(name, 0)

    def named(self, expression: Expression) -> Expression | None:
        """Return the name of a definition of the program or of a lookup; None: it is neither."""
        if expression in self._named:
            return self._named[expression]
        if expression in self._definitions:
            name = self._definitions.pop(expression)  # its own text does not use the name
            exact = exact_truth if self.domains.is_truth(expression) else exact_whole
            form = exact(expression, self)
            self._named[expression] = self.formula(name, form)
        elif isinstance(expression, Lookup):
            self._named[expression] = self.table(expression)
        return self._named.get(expression)

    def table(self, expression: Expression) -> Expression:
        """Return the same as a name or a short tree, without anything for engines to compute.

        Raises:
            InputError: the expression reads too many values.
        """
        if expression not in self._tables:
            try:
                form = table_of(expression, self.domains)
            except InputError as error:
                raise InputError(f"{error.message}: {_shortened(self._readable(expression))}") from error
            self._tables[expression] = self._kept(expression, form)
        return self._tables[expression]

    def _kept(self, expression: Expression, form: Expression) -> Expression:
        if isinstance(expression, Lookup) and expression.table.name:
            return self.formula(_name_of(expression), form, expression.table.meaning)
        if len(text_of(form)) <= MAX_INLINE:
            return form
        if isinstance(expression, Lookup):
            return self.formula(_name_of(expression) or "place", form)
        self._numbered += 1
        kind = "test" if self.domains.is_truth(expression) else "value"
        return self.formula(f"{kind}_{self._numbered}", form, _shortened(self._readable(expression)))

    def _readable(self, expression: Expression) -> str:
        return text_of(_with_names(expression))


def text_of(form: Expression) -> str:
    """Return the text of a form without lookups."""
    return _COMPARISON.sub(r"\1\2\3", render(form))


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_COMMENT else f"{text[:MAX_COMMENT]}..."


def _with_names(expression: Expression) -> Expression:
    if isinstance(expression, Lookup):
        return Variable(_name_of(expression) or "place", 0)
    return with_parts(expression, tuple(map(_with_names, parts(expression))))


def _name_of(lookup: Lookup) -> str:
    """Return the name of a table, and how it is got at: `light_east`."""
    steps = dict.fromkeys(inner.table.step or inner.table.name for inner in _lookups(lookup.index))
    return "_".join(filter(None, [lookup.table.name, *steps]))


def _lookups(expression: Expression) -> Iterator[Lookup]:
    if isinstance(expression, Lookup):
        yield expression
    for part in parts(expression):
        yield from _lookups(part)
