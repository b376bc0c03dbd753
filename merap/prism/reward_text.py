"""Write rewards as PRISM text: the expectation where they read the successor, and without losses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import floor

from merap.errors import InputError
from merap.prism.engine_form import engine_form, joined
from merap.prism.engine_text import EngineText, text_of
from merap.prism.exact_form import least
from merap.prism.joint_outcomes import joint_outcomes
from merap.program.expressions import (
    TRUE,
    ZERO,
    Constant,
    Expression,
    Operation,
    Variable,
    product_of,
    substitute,
    variables,
)
from merap.program.form import Command, Program, RewardItem, RewardStructure


@dataclass(frozen=True)
class RewardsText:
    """`rewards "name"`, and `[action] guard : value` lines; a constant and a comment before it."""

    name: str
    items: tuple[str, ...]
    constant: str = ""
    comment: str = ""


@dataclass(frozen=True)
class _Item:
    """What the steps of an action earn where a guard holds."""

    action: str | None
    guard: Expression
    value: Expression


def rewards_text(program: Program, text: EngineText) -> list[RewardsText]:
    """Return the reward structures of a program.

    Raises:
        InputError: an expression can't be written exactly; a reward reads successors that have more than 256
            joint outcomes, or has no lower bound although a structure without losses is asked for.
    """
    written: list[RewardsText] = []
    for name, structure in program.rewards.items():
        if structure.first_match:
            written += _Expected(program, text, structure).texts(name)
            continue
        items = tuple(line for rule in structure.rules for line in _plain(program, text, rule))
        written.append(RewardsText(name, items or ("true : 0",)))
        if structure.shift is not None:
            losses = (min(least(engine_form(rule.value), text), Fraction(0)) for rule in structure.rules)
            more = f"true : {structure.shift}"
            written.append(_without_losses(name, (*items, more), structure.shift, sum(losses, Fraction(0))))
    return written


def _without_losses(name: str, items: tuple[str, ...], shift: str, lowest: Fraction) -> RewardsText:
    """Return the structure in which every step earns a constant more, so that none earns less than 0."""
    return RewardsText(
        f"{name}_shifted",
        items or ("true : 0",),
        f"const double {shift} = {floor(-lowest) + 1}",
        "every step of every state plus a constant: PRISM-games takes no negative reward",
    )


def _plain(program: Program, text: EngineText, rule: RewardItem) -> list[str]:
    """Return the lines of a rule that counts whatever else matches."""
    if _primed([rule]):
        raise InputError(f"{program.name}: a reward that is added to others can't read the successor in text")
    line = f"{wrapped(text.truth_form(rule.guard))} : {wrapped(text.number_form(rule.value))}"
    if not rule.actions:
        return [line]
    actions = sorted(rule.actions & {None, *program.actions}, key=lambda name: name or "")
    return [f"[{action or ''}] {line}" for action in actions]


def wrapped(form: Expression) -> str:
    """Return its text, in parentheses where a `:` in it might be taken for the item's."""
    text = text_of(form)
    return f"({text})" if isinstance(form, Operation) and form.operator == "?:" else text


def _primed(rules: Sequence[RewardItem]) -> set[str]:
    read = (name for rule in rules for part in (rule.guard, rule.value) for name in variables(part))
    return {one.name.removesuffix("'") for one in read if one.name.endswith("'")}


class _Expected:
    """Rewards of which the first rule that matches counts; commands of one action exclude each other."""

    def __init__(self, program: Program, text: EngineText, structure: RewardStructure) -> None:
        self._program, self._text, self._structure = program, text, structure
        self._least = Fraction(0)

    def texts(self, name: str) -> Iterator[RewardsText]:
        """Yield the structure and, if it is asked for, the one without losses."""
        alone = any(one.action is None for process in self._program.processes for one in process.commands)
        items = [
            item
            for action in (*self._program.actions, *([None] if alone else []))
            for item in self._items(action)
        ]
        shift = self._structure.shift
        paid = items if shift is None else [self._pay(item, items) for item in items]
        lines = [_line(item.action, item.guard, item.value) for item in paid if item.value != ZERO]
        yield RewardsText(name, tuple(lines) or ("true : 0",))
        if shift is not None:
            yield _without_losses(name, tuple(self._shifted(paid, shift)), shift, self._least)

    def _pay(self, item: _Item, items: Sequence[_Item]) -> _Item:
        """Give the value a name, as two structures use it."""
        own = [one for one in items if one.action == item.action]
        number = f"_{own.index(item) + 1}" if len(own) > 1 else ""
        return _Item(
            item.action, item.guard, self._text.formula(f"pay_{item.action or 'alone'}{number}", item.value)
        )

    def _shifted(self, items: Sequence[_Item], shift: str) -> Iterator[str]:
        for item in items:
            more: Expression = Variable(shift, 0)
            if item.value != ZERO:
                more = Operation("+", (more, item.value))
            yield _line(item.action, item.guard, more)

    def _items(self, action: str | None) -> list[_Item]:
        rules = [rule for rule in self._structure.rules if not rule.actions or action in rule.actions]
        read = _primed(rules)
        drawn = [
            [command for command in process.commands if command.action == action]
            for process in self._program.processes
            if action in {command.action for command in process.commands}
            and read & {variable.name for variable in process.variables}
        ]
        if drawn and action is None:
            raise InputError(
                f"{self._program.name}: the reward of a step without action can't read the successor in text"
            )
        items = []
        for commands in product(*drawn):
            guard: Expression = TRUE
            if any(len(own) > 1 for own in drawn):
                guard = joined("&", [command.guard for command in commands])
            items.append(
                _Item(action, self._text.truth_form(guard), self._expectation(rules, commands, read))
            )
        if len({item.value for item in items}) == 1:
            return [_Item(action, TRUE, items[0].value)]
        return items

    def _expectation(
        self, rules: Sequence[RewardItem], commands: Sequence[Command], read: set[str]
    ) -> Expression:
        terms: list[tuple[Expression, Expression]] = []
        for outcome in joint_outcomes(commands):
            after = {f"{name}'": outcome.assignments.get(name, Variable(name, 0)) for name in sorted(read)}
            probability = self._text.probability_form(outcome.probability)
            if probability != ZERO:
                terms.append((probability, self._first_match(rules, after)))
        values = {value for _, value in terms}
        if len(values) == 1:
            return values.pop()
        total = [product_of(term) for term in terms if term[1] != ZERO]
        result = total[0]
        for term in total[1:]:
            result = Operation("+", (result, term))
        return result

    def _first_match(self, rules: Sequence[RewardItem], after: dict[str, Expression]) -> Expression:
        cases: list[tuple[Expression, Expression]] = []
        last: Expression = ZERO
        for rule in rules:
            guard = self._text.truth_form(substitute(rule.guard, after))
            if guard == Constant(False):
                continue
            value = engine_form(substitute(rule.value, after))
            self._least = min(self._least, least(value, self._text))
            form = self._text.number_form(value)
            if guard == TRUE:
                last = form
                break
            cases.append((guard, form))
        for guard, form in reversed(cases):
            last = last if form == last else Operation("?:", (guard, form, last))
        return last


def _line(action: str | None, guard: Expression, value: Expression) -> str:
    return f"[{action or ''}] {wrapped(guard)} : {wrapped(value)}"
