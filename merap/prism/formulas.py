"""Expressions over a step as PRISM text, and the formulas that it refers to."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from fractions import Fraction

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.space import Attribute
from merap.mdp.model import Ints
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.prism.engine_form import engine_form, is_table
from merap.prism.exactness import COMPARISONS, is_computed_right, is_decided_right, is_truth
from merap.prism.lines import Formula
from merap.prism.location_text import cases, predicate
from merap.prism.tables import table_of
from merap.prism.terms import bare
from merap.program.expressions import (
    Constant,
    Expression,
    Levels,
    Operation,
    Variable,
    exact,
    fold,
    render,
    render_constant,
)

TABLE = "="  # begins the variables that stand for a table; no name of a user does
MAX_COMMENT = 100
_NEXT_MODE = f"{MODE_VARIABLE}'"
# A comparison of two names or numbers, which reads best without spaces: mode=2.
_COMPARISON = re.compile(
    r"(?<![-+*/<=] )(?<![^=]> )\b([A-Za-z_]\w*) (!=|<=|>=|=|<|>) (-?\w+)\b(?!/| [-+*/<>=!])"
)


class Formulas:
    """Writes expressions, and remembers which formulas of attributes they need.

    In all methods `move` is the index of the edge label that the step goes along, None if it stays;
    `before` and `after` are the mode and the successor mode, if they are known.
    """

    def __init__(self, combination: Combination) -> None:
        self.combination = combination
        self.space = combination.space
        self._formulas: dict[str, Formula] = {}
        self._tables: dict[tuple[Expression, int | None, tuple[int, ...]], Expression] = {}
        self._names: dict[str, tuple[str, int | None]] = {}
        self._taken: set[str] = set()
        self._passable = combination.passable
        self._by_name = {attribute.name: attribute for attribute in combination.environment.attributes}

    def take(self) -> list[Formula]:
        """The formulas that were needed and not taken before."""
        fresh = sorted(self._formulas.keys() - self._taken)
        self._taken |= self._formulas.keys()
        return [self._formulas[name] for name in fresh]

    def there(self, move: int | None) -> Ints:
        """int64 [P]: where a move leads from each location, itself where that is blocked."""
        here = np.arange(self.space.num_locations)
        if move is None:
            return here
        return np.where(self._passable[:, move], self.space.target[:, move], here)

    def number(
        self, expression: Expression, move: int | None, before: int | None = None, after: int | None = None
    ) -> str:
        """Write an expression: a constant, a name, or in parentheses."""
        form = self._exact(self._form(expression, move, before, after), move)
        return self._enclosed(form, move, always=True)

    def truth(
        self, expression: Expression, move: int | None, before: int | None = None, after: int | None = None
    ) -> str:
        """Write a condition: `true`, `false`, a name, a comparison, or in parentheses."""
        form = self._exact(self._form(expression, move, before, after), move)
        return self._enclosed(form, move, always=False)

    def probability(self, expression: Expression, intended: int | None) -> str:
        """Write the probability of an outcome: a constant, a name, or in parentheses.

        Engines add and subtract none, as they would round 0 to something else.
        """
        form = self._form(expression, intended, None, None)
        if is_table(form):
            return self._enclosed(self._exact(form, intended), intended, always=True)
        terminal = np.flatnonzero(self.combination.capability.terminal(len(self.combination.modes)))
        return self._enclosed(self._tabulated(form, intended, terminal.tolist()), intended, always=True)

    def _form(
        self, expression: Expression, move: int | None, before: int | None, after: int | None
    ) -> Expression:
        known = {MODE_VARIABLE: before, _NEXT_MODE: before if after is None else after}
        folded = fold(expression, {name: Fraction(mode) for name, mode in known.items() if mode is not None})
        unchanged = (
            {_NEXT_MODE} if move is not None else {_NEXT_MODE, *(f"{name}'" for name in self._by_name)}
        )
        return engine_form(_unprimed(folded, unchanged))

    def _exact(self, form: Expression, move: int | None) -> Expression:
        """The same with names for what engines would decide, or compute wrongly, on rounded numbers."""
        mended = self._mended(form, move)
        return form if mended == form else engine_form(mended)

    def _mended(self, form: Expression, move: int | None) -> Expression:
        if not isinstance(form, Operation):
            return form
        if form.operator in COMPARISONS and not is_truth(form.arguments[0], self._levels):
            is_right = is_decided_right(form, self._levels)
        else:
            is_right = is_truth(form, self._levels) or is_computed_right(form, self._levels)
        if not is_right:
            return self._tabulated(form, move, range(len(self.combination.modes)))
        return Operation(form.operator, tuple(self._mended(part, move) for part in form.arguments))

    def _levels(self, name: str) -> Levels:
        if name == MODE_VARIABLE:
            return Levels(tuple(map(Fraction, range(len(self.combination.modes)))))
        return self._by_name[name.removesuffix("'")].column.levels

    def _tabulated(self, form: Expression, move: int | None, modes: Sequence[int]) -> Expression:
        """The name of a formula that says what `form` is in each state, or its value."""
        key = (form, move, tuple(modes))
        if key not in self._tables:
            default = False if is_truth(form, self._levels) else Fraction(0)
            table = table_of(self.combination, form, self.there(move), modes, default)
            self._tables[key] = table if isinstance(table, Constant) else self._named(form, table)
        return self._tables[key]

    def _named(self, form: Expression, table: str) -> Expression:
        number = len(self._tables) + 1
        kind = "test" if is_truth(form, self._levels) else "value"
        name = self._new_name(f"attribute_{kind}_{number}", (TABLE, number))
        meaning = _spaced(render(form))
        shortened = meaning if len(meaning) <= MAX_COMMENT else f"{meaning[:MAX_COMMENT]}..."
        self._formulas[name] = Formula(name, table, shortened)
        return Variable(TABLE + name, 0)

    def _new_name(self, name: str, meaning: tuple[str, int | None]) -> str:
        """The name, made different from that of anything else."""
        while self._names.setdefault(name, meaning) != meaning:
            name += "_"
        return name

    def _enclosed(self, form: Expression, move: int | None, *, always: bool) -> str:
        """The text, in parentheses if it is an operation; comparisons, if `always`."""
        text = _spaced(render(form, self._rename(move)))
        loose = isinstance(form, Operation) and (always or form.operator not in COMPARISONS)
        return f"({text})" if loose else text

    def _rename(self, move: int | None) -> Callable[[str], str]:
        def rename(name: str) -> str:
            if name == MODE_VARIABLE or name.startswith(TABLE):
                return name.removeprefix(TABLE)
            attribute = self._by_name[name.removesuffix("'")]
            return self._attribute(attribute, move if name.endswith("'") else None)

        return rename

    def _attribute(self, attribute: Attribute, move: int | None) -> str:
        """The name of the formula for an attribute here, or where `move` leads."""
        label = "" if move is None else f"_{self.space.moves[move]}"
        # Another attribute and label may make the same name.
        name = self._new_name(f"attribute_{attribute.name}{label}", (attribute.name, move))
        if name in self._formulas:
            return name
        values = attribute.values[self.there(move)]
        if attribute.kind == "bool":
            text = predicate(self.space, values != 0)
        else:
            unique, index = np.unique(values, return_inverse=True)
            text = cases(self.space, [render_constant(exact(value)) for value in unique.tolist()], index)
        self._formulas[name] = Formula(name, bare(text))
        return name


def _spaced(text: str) -> str:
    return _COMPARISON.sub(r"\1\2\3", text)


def _unprimed(expression: Expression, unchanged: Collection[str]) -> Expression:
    """Variables in `unchanged` without their prime."""
    if isinstance(expression, Variable) and expression.name in unchanged:
        return Variable(expression.name.removesuffix("'"), expression.column)
    if not isinstance(expression, Operation):
        return expression
    return Operation(
        expression.operator, tuple(_unprimed(argument, unchanged) for argument in expression.arguments)
    )
