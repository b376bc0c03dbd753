"""Parse PRISM text by Storm, and write the program that it is: `prism_reading` starts this as a process."""

from __future__ import annotations

import pickle
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import stormpy
from stormpy.developer.storage._storage import ExpressionParser

from merap.checker.prism_model import ConstantType, PrismModel
from merap.errors import InputError, shortened
from merap.program.expressions import ONE, ZERO, Constant, Expression, Operation, Variable, fold
from merap.program.form import (
    Command,
    InitialValues,
    Process,
    Program,
    RewardItem,
    RewardStructure,
    StateVariable,
    Update,
)

GLOBALS = "globals"
MAX_MESSAGE = 400
_TYPES: Mapping[str, ConstantType] = {"int": "int", "bool": "bool", "rational": "double"}
_OPERATORS = {
    "AND": "&",
    "OR": "|",
    "XOR": "!=",
    "IMPLIES": "=>",
    "IFF": "<=>",
    "PLUS": "+",
    "MINUS": "-",
    "TIMES": "*",
    "DIVIDE": "/",
    "MIN": "min",
    "MAX": "max",
    "POWER": "pow",
    "MODULO": "mod",
    "EQUAL": "=",
    "NOT_EQUAL": "!=",
    "LESS": "<",
    "LESS_OR_EQUAL": "<=",
    "GREATER": ">",
    "GREATER_OR_EQUAL": ">=",
    "NOT": "!",
    "FLOOR": "floor",
    "CEIL": "ceil",
    "ITE": "?:",
}


def parse_model(path: Path, name: str) -> PrismModel:
    """Parse a PRISM file.

    Args:
        path: of the file.
        name: of the program.

    Raises:
        RuntimeError: from Storm.
        InputError: a global variable is written by a command with an action.
    """
    parsed = stormpy.parse_prism_program(path, prism_compatibility=True, simplify=False)
    parsed = parsed.substitute_formulas().substitute_constants()
    has_predicate = parsed.has_initial_states_expression
    shared = [*parsed.global_integer_variables, *parsed.global_boolean_variables]
    processes = [_process(module, starts=not has_predicate) for module in parsed.modules]
    _require_unshared(processes, {variable.name for variable in shared})
    if shared:
        of_globals = (parsed.global_integer_variables, parsed.global_boolean_variables)
        processes.append(_variables_only(GLOBALS, *of_globals, starts=not has_predicate))
    program = Program(
        name=name,
        processes=tuple(processes),
        labels={label.name: read_tree(label.expression) for label in parsed.labels},
        rewards=dict(_rewards(parsed)),
        initial_predicate=read_tree(parsed.initial_states_expression) if has_predicate else None,
    )
    return PrismModel(
        program,
        {one.name: _TYPES[str(one.type)] for one in parsed.constants if not one.defined},
        {
            **{one.name: read_tree(one.definition) for one in parsed.constants if one.defined},
            **dict(read_formulas(parsed)),
        },
    )


def _process(module: Any, *, starts: bool) -> Process:
    declared = _variables_only(module.name, module.integer_variables, module.boolean_variables, starts=starts)
    return Process(
        declared.name,
        declared.concern,
        declared.variables,
        tuple(_command(module.name, command) for command in module.commands),
        declared.initial,
    )


def _variables_only(name: str, integers: Any, booleans: Any, *, starts: bool) -> Process:
    variables = [
        StateVariable(one.name, read_tree(one.lower_bound_expression), read_tree(one.upper_bound_expression))
        for one in integers
    ]
    variables += [StateVariable(one.name, ZERO, ONE, "bool") for one in booleans]
    values = {}
    if starts:
        values = {one.name: read_tree(one.initial_value_expression) for one in (*integers, *booleans)}
    return Process(name, "environment", tuple(variables), (), (InitialValues(ONE, values),))


def _command(module: str, command: Any) -> Command:
    outcomes = tuple(
        Update(
            read_tree(update.probability_expression),
            {one.variable.name: read_tree(one.expression) for one in update.assignments},
        )
        for update in command.updates
    )
    action = command.action_name if command.labeled else None
    place = f"[{action or ''}] in module {module}"
    return Command(action, read_tree(command.guard_expression), (outcomes,), place)


def read_tree(given: Any) -> Expression:
    """Return an expression of Storm as a tree."""
    if given.is_variable():
        return Variable(str(given.get_identifier()), 0)
    if given.is_literal():
        if given.has_boolean_type():
            return Constant(bool(given.evaluate_as_bool()))
        value = given.evaluate_as_rational()
        return Constant(Fraction(int(str(value.numerator)), int(str(value.denominator))))
    name = given.operator.name
    arguments = tuple(read_tree(given.get_operand(place)) for place in range(given.arity))
    if name == "MINUS" and len(arguments) == 1:
        return _constant_part(Operation("neg", arguments))
    return _constant_part(_as_written(Operation(_OPERATORS[name], arguments)))


def _constant_part(found: Operation) -> Expression:
    """Compute it if its arguments are constants; an undefined result stays, as it may never be reached."""
    if not all(isinstance(argument, Constant) for argument in found.arguments):
        return found
    try:
        return fold(found, {})
    except InputError:
        return found


def _as_written(found: Operation) -> Operation:
    """Undo Storm's rewriting of mod(a, b) to a >= 0 ? a % b : (a % b) + b, which is b, not 0, at a = -b."""
    if found.operator == "?:":
        modulo = found.arguments[1]
        if isinstance(modulo, Operation) and modulo.operator == "mod":
            rewritten = Operation(
                "?:", (_not_negative(modulo), modulo, Operation("+", (modulo, modulo.arguments[1])))
            )
            if found == rewritten:
                return modulo
    return found


def _not_negative(modulo: Operation) -> Expression:
    return Operation(">=", (modulo.arguments[0], ZERO))


def _require_unshared(processes: list[Process], shared: set[str]) -> None:
    for process in processes:
        for command in process.commands:
            written = {name for draw in command.draws for one in draw for name in one.assignments}
            if command.action is not None and written & shared:
                raise InputError(
                    f"the global variable {min(written & shared)} is written by a command with an action "
                    f"([{command.action}] in {process.name}); engines differ in what that means: let one "
                    "module own it"
                )


def _parser(parsed: Any) -> Any:
    """Return a parser for what is in Storm's normalised text only."""
    parser = ExpressionParser(parsed.expression_manager)
    parser.set_identifier_mapping({one.name: one.get_expression() for one in parsed.variables})
    return parser


def read_formulas(parsed: Any) -> Iterator[tuple[str, Expression]]:
    """Yield the names and definitions of the formulas of stormpy's program."""
    parser = _parser(parsed)
    for found in re.finditer(r"^formula (\w+) = (.*);$", str(parsed), re.MULTILINE):
        with suppress(RuntimeError):  # a number is too long for it; where it is used it has been read
            yield found[1], read_tree(parser.parse_from_string(found[2]))


def _rewards(parsed: Any) -> Iterator[tuple[str, RewardStructure]]:
    parser = _parser(parsed)
    for block in re.finditer(
        r'^rewards(?: "([^"]*)")?\n(.*?)^endrewards', str(parsed), re.MULTILINE | re.DOTALL
    ):
        rules = tuple(_rule(parser, line.strip()) for line in block[2].splitlines() if line.strip())
        yield block[1] or "", RewardStructure(rules)


def _rule(parser: Any, item: str) -> RewardItem:
    """Read `[action] guard: value;` or `guard: value;`."""
    actions: frozenset[str | None] = frozenset()
    if found := re.match(r"\[(\w*)\] ", item):
        actions, item = frozenset({found[1] or None}), item[found.end() :]
    signs = np.array(list(item))
    depth = np.cumsum(signs == "(") - np.cumsum(signs == ")")
    place = int(np.flatnonzero((signs == ":") & (depth == 0))[0])
    value, guard = item[place + 1 :].rstrip(";"), item[:place]
    try:
        return RewardItem(
            read_tree(parser.parse_from_string(value)), read_tree(parser.parse_from_string(guard)), actions
        )
    except RuntimeError as error:
        raise InputError(f"the reward {shortened(item, 80)} can't be read") from error


def main(given: str, found: str, name: str) -> None:
    """Write the model, or the fault of the text and its line."""
    result: PrismModel | tuple[str, int | None]
    try:
        result = parse_model(Path(given), name)
    except RuntimeError as error:
        result = _message(str(error))
    except InputError as error:
        result = error.message, None
    Path(found).write_bytes(pickle.dumps(result))


def _message(text: str) -> tuple[str, int | None]:
    """Return Storm's message in one line, and the line of the text that it means."""
    message = " ".join(line.strip(" \t^") for line in text.splitlines()).strip()
    found = re.search(r"(?:Parsing error at |[Ll]ine )(\d+)", message)
    message = re.sub(r" \([^()]*, line \d+\)", "", message)  # the file that Storm read is none of the user's
    message = shortened(message.removeprefix("WrongFormatException: "), MAX_MESSAGE)
    return message, int(found[1]) if found else None


if __name__ == "__main__":
    main(*sys.argv[1:])
