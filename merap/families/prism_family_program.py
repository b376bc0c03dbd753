"""Make an open program of PRISM text: the concerns own its parts, the objective ends and rewards it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

from merap.checker.prism_model import PrismModel
from merap.concerns.document import KeyPath
from merap.concerns.location_words import AT
from merap.concerns.parameters import parameter_name
from merap.concerns.resolution_context import ResolutionContext, as_expression
from merap.concerns.schema_program import WrittenObjectiveSpec, WrittenRewardSpec
from merap.errors import InputError
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION, GOAL_LABEL, UNSAFE_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.program.closing import with_expressions
from merap.program.completion import completed, enabled
from merap.program.expressions import (
    FALSE,
    ONE,
    TRUE,
    Constant,
    Expression,
    Kind,
    Operation,
    Variable,
    all_of,
    negation,
    parts,
    substitute,
    with_parts,
)
from merap.program.form import ConcernName, Program, RewardItem, RewardStructure
from merap.program.names import suggestion, unique_name
from merap.program.renaming import renamed
from merap.program.unique_actions import unique_actions

REWARD, STEPS, SHIFT = "objective", "steps", "shift"


@dataclass(frozen=True, eq=False, repr=False)
class OpenProgram(ShortRepr):
    """A text with its objective, before its actions are unique.

    Attributes:
        program: with the labels and rewards of the objective; parameters are called `<concern>.<name>`.
        complete: where the task is complete.
        renamed: names of the text that have another meaning in every case, and what they are called.
    """

    program: Program
    complete: Expression
    renamed: Mapping[str, str]

    def finished(self, ambiguous: Collection[str]) -> Program:
        """Return the program with unique actions, complete states included.

        Args:
            ambiguous: actions of which two commands of a process may be enabled at once.
        """
        unique = unique_actions(self.program, ambiguous)
        name = unique_name(REWARD, {process.name for process in unique.processes})
        return completed(unique, self.complete, name)


def open_program(
    model: PrismModel,
    owners: Mapping[str, ConcernName],
    spec: WrittenObjectiveSpec,
    context: ResolutionContext,
) -> OpenProgram:
    """Return the program of a text under an objective.

    Args:
        model: the text; constants that it leaves open are parameters.
        owners: module -> the concern that owns it; the environment owns the others.
        spec: the objective.
        context: knows the parameters of the concerns.

    Raises:
        InputError: an expression of the objective is wrong, or there is no such structure or action.
    """
    program = replace(
        model.program,
        processes=tuple(
            replace(process, concern=owners.get(process.name, process.concern))
            for process in model.program.processes
        ),
    )
    watching = [process for process in program.processes if process.concern == "objective"]
    program = replace(
        program, monitors=frozenset(one.name for process in watching for one in process.variables)
    )
    end = {END_ACTION: unique_name(f"{END_ACTION}_", program.actions)}
    program = renamed(program, actions=end)
    compiled = _Compiler(model, program, context)
    complete = FALSE if spec.ends_in is None else compiled(("ends_in",), spec.ends_in)
    own = {COMPLETE_LABEL: complete, GOAL_LABEL: FALSE}
    for name, given in ((GOAL_LABEL, spec.goal), (UNSAFE_LABEL, spec.unsafe)):
        if given is not None or name in program.labels:
            own[name] = compiled((name,), f'"{name}"' if given is None else given)
    program = _with_resolved_parameters(program, context)
    going = negation(complete)
    labels, other_labels = _beside(own, program.labels, frozenset(own))
    rewards, other_rewards = _beside(
        {REWARD: _structure(program, spec, compiled, going)},
        {name: one for name, one in program.rewards.items() if not name == spec.reward == REWARD},
        frozenset({REWARD, f"{REWARD}_shifted"}),
    )
    rewards.setdefault(STEPS, RewardStructure((RewardItem(ONE, going),)))
    definitions = {} if isinstance(complete, Constant) else {"complete": complete}
    return OpenProgram(
        replace(program, labels=labels, rewards=rewards, definitions=definitions),
        complete,
        {
            **({} if END_ACTION not in model.program.actions else end),
            **other_labels,
            **other_rewards,
        },
    )


Named = TypeVar("Named")


def _beside(
    own: Mapping[str, Named], given: Mapping[str, Named], reserved: Collection[str]
) -> tuple[dict[str, Named], dict[str, str]]:
    """Return what has our names and what the text names, and names of the text that had to give way."""
    joined, changed = dict(own), {}
    for name, one in given.items():
        if name not in reserved:
            joined[name] = one
        elif own.get(name) != one:
            changed[name] = unique_name(f"{name}_", {*own, *given})
            joined[changed[name]] = one
    return joined, changed


@dataclass(frozen=True, eq=False, repr=False)
class _Compiler(ShortRepr):
    """Compiles the objective's expressions over a text's variables, constants, formulas and labels."""

    model: PrismModel
    program: Program
    context: ResolutionContext

    @cached_property
    def _context(self) -> ResolutionContext:
        variables = {
            one.name: (process.concern, one)
            for process in self.program.processes
            for one in process.variables
        }
        return replace(self.context, variables=variables)

    @cached_property
    def _definitions(self) -> Mapping[str, Expression]:
        labels = {f'"{name}"': where for name, where in self.program.labels.items()}
        return {'"deadlock"': negation(enabled(self.program)), **labels, **self.model.definitions}

    def __call__(
        self, path: KeyPath, given: str | float, expected: Kind = "bool", *, of_step: bool = False
    ) -> Expression:
        place: KeyPath = ("objective", *path)
        with self.context.document.at(*place):
            expression = self._defined(as_expression(given))
        names = self._context.names("objective", primed=("processes",) if of_step else ())
        return self._context.compile(place, expression, names, expected)

    def _defined(self, expression: Expression) -> Expression:
        """Put in what constants, formulas and labels of the text stand for; `at(..)` names no such thing."""
        if isinstance(expression, Variable):
            return self._meaning(expression)
        if isinstance(expression, Operation) and expression.operator.startswith(AT):
            return expression
        return with_parts(expression, tuple(map(self._defined, parts(expression))))

    def _meaning(self, variable: Variable) -> Expression:
        if variable.name.startswith('"') and variable.name not in self._definitions:
            labels = [name for name in self._definitions if name.startswith('"')]
            known = suggestion(variable.name, labels)
            raise InputError(f"unknown label {variable.name} at column {variable.column}{known}")
        return self._definitions.get(variable.name, variable)

    def error(self, path: KeyPath, message: str) -> InputError:
        return self.context.document.error(("objective", *path), message)


def _with_resolved_parameters(program: Program, context: ResolutionContext) -> Program:
    names = {
        name: Variable(parameter_name(concern, name), 0)
        for concern, types in context.parameters.items()
        for name in types
    }
    return with_expressions(program, lambda expression: substitute(expression, names))


def _structure(
    program: Program, spec: WrittenObjectiveSpec, compiled: _Compiler, going: Expression
) -> RewardStructure:
    """Return what steps earn; none from a complete state earns anything."""
    shift = unique_name(SHIFT, {one.name for one in program.variables})
    if spec.rewards is not None:
        rules = tuple(_rule(compiled, place, rule) for place, rule in enumerate(spec.rewards))
    elif spec.reward is None:
        rules = ()
    elif spec.reward in program.rewards:
        rules = program.rewards[spec.reward].rules
        if spec.sign == -1:
            rules = tuple(replace(rule, value=Operation("neg", (rule.value,))) for rule in rules)
    else:
        known = suggestion(spec.reward, program.rewards)
        raise compiled.error(("reward",), f"the text has no reward structure {spec.reward!r}{known}")
    gated = (rule if rule.actions else replace(rule, guard=all_of([going, rule.guard])) for rule in rules)
    return RewardStructure(tuple(gated), first_match=spec.rewards is not None, shift=shift)


def _rule(compiled: _Compiler, place: int, spec: WrittenRewardSpec) -> RewardItem:
    where = spec.where
    return RewardItem(
        compiled(("rewards", place, "value"), spec.value, "number", of_step=True),
        TRUE if where is None else compiled(("rewards", place, "where"), where, of_step=True),
        frozenset(spec.action or ()),
    )
