"""Resolve configurations of the capability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

from merap.concerns.closing import possible
from merap.concerns.combination import Capability
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import CONCERNS, ExpressionNames
from merap.concerns.external_action import ExternalAction, Outcome, Sets
from merap.concerns.innate import Innate, InnateAction
from merap.concerns.parameters import Values, constants, held_locations, present_all
from merap.concerns.resolution_context import ResolutionContext, names_in, noting
from merap.concerns.resolve_changes import ChangeReader
from merap.concerns.resolve_processes import ProcessResolver, process_entries
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_capability import STAY, ActionSpec, InnateSpec, OutcomeSpec, restarts
from merap.concerns.schema_processes import SetSpec
from merap.errors import InputError
from merap.mdp.model import ROW_SUM_TOLERANCE
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import FALSE, ONE, Constant, Constants, Expression, Operation, fold
from merap.program.form import StateVariable
from merap.program.names import suggestion

NO_ENTRY = "no_entry"


@dataclass(frozen=True, eq=False, repr=False)
class InnateTemplate(ShortRepr):
    """The automaton before parameters are put in; modes are indices."""

    requires: Expression
    entry: int
    initial: int
    terminal: frozenset[int]
    restart: bool
    actions: Mapping[str, Mapping[int, Mapping[int, Expression]]]


class CapabilityResolver:
    """Makes capabilities from parameter values; call it with a name and values.

    Raises:
        InputError: an expression is wrong, or a label or mode unknown.
    """

    def __init__(self, context: ResolutionContext, case: CaseSpec) -> None:
        self.context = context
        self.spec = spec = case.capability
        self._changes = ChangeReader(context, "capability")
        self._settable = {
            entry.name: entry for concern in CONCERNS for entry in process_entries(case, concern)
        }
        self.actions = tuple(self._action(name, entry) for name, entry in spec.actions.items())
        self.innate = self._innate(spec.innate) if spec.innate is not None else None
        self.processes = ProcessResolver(context, process_entries(case, "capability"))

    @property
    def _own(self) -> ExpressionNames:
        """The automaton is the system's alone: it reads parameters of the capability."""
        return self.context.names("capability", of_state=False, foreign=False)

    def _action(self, name: str, spec: ActionSpec) -> ExternalAction:
        path = ("capability", "actions", name)
        requires = self.context.compile(
            (*path, "requires"), spec.requires, self.context.names("capability"), "bool"
        )
        if spec.outcomes is not None:
            outcomes = self._listed_outcomes((*path, "outcomes"), spec.outcomes)
        elif spec.move is not None:
            outcomes = self._move_or_otherwise(path, spec.move, spec)
        else:
            outcomes = (Outcome(None, ONE),)
        return ExternalAction(
            name, outcomes, spec.on_blocked, requires, self._sets((*path, "sets"), spec.sets)
        )

    def _listed_outcomes(self, path: KeyPath, specs: tuple[OutcomeSpec, ...]) -> tuple[Outcome, ...]:
        return tuple(
            Outcome(
                self._move((*path, index, "move"), spec.move),
                self._probability((*path, index, "probability"), spec.probability),
                self._sets((*path, index, "sets"), spec.sets),
            )
            for index, spec in enumerate(specs)
        )

    def _move_or_otherwise(self, path: KeyPath, label: str, spec: ActionSpec) -> tuple[Outcome, ...]:
        probability = self._probability(
            (*path, "probability"), 1 if spec.probability is None else spec.probability
        )
        otherwise = self._move((*path, "otherwise"), spec.otherwise or STAY)
        return (
            Outcome(self._move((*path, "move"), label), probability),
            Outcome(otherwise, Operation("-", (ONE, probability))),
        )

    def _sets(self, path: KeyPath, specs: Mapping[str, SetSpec]) -> Sets:
        return tuple(
            (name, self._changes.change((*path, name), spec, self._set_process((*path, name), name), None))
            for name, spec in specs.items()
        )

    def _set_process(self, path: KeyPath, name: str) -> Mapping[str, StateVariable]:
        """Return the variables of a process that actions may set."""
        entry = self._settable.get(name)
        if entry is None:
            known = [one.name for one in self._settable.values() if one.concern != "objective"]
            owners = [one.name for one in self._settable.values() if name in one.variables]
            near = f": it is a variable of {owners[0]}" if owners else suggestion(name, known)
            raise self.context.document.error(path, f"unknown process {name!r}{near}")
        if entry.concern == "objective":
            raise self.context.document.error(
                path, f"the process {name} belongs to the objective, which only watches"
            )
        return entry.variables

    def _probability(self, path: KeyPath, given: float | str) -> Expression:
        return self.context.compile(
            path, given, self.context.names("capability", primed=("attributes",)), "number"
        )

    def _move(self, path: KeyPath, label: str) -> int | None:
        if label == STAY:
            return None
        moves = self.context.space.moves
        if label not in moves:
            raise self.context.document.error(
                path, f"unknown edge label {label!r}{suggestion(label, (*moves, STAY))}"
            )
        return moves.index(label)

    def _innate(self, spec: InnateSpec) -> InnateTemplate:
        path = ("capability", "innate")
        terminal = frozenset(
            self._mode((*path, "terminal", index), name)
            for index, name in enumerate(spec.terminal or spec.modes)
        )
        return InnateTemplate(
            requires=self.context.compile(
                (*path, "requires"), spec.requires, self.context.names("capability"), "bool"
            ),
            entry=0 if spec.entry is None else self._mode((*path, "entry"), spec.entry),
            initial=0 if spec.initial is None else self._mode((*path, "initial"), spec.initial),
            terminal=terminal,
            restart=restarts(spec),
            actions={
                action: {
                    self._mode((*path, "actions", action, mode), mode): self._row(
                        (*path, "actions", action, mode), row
                    )
                    for mode, row in rows.items()
                }
                for action, rows in spec.actions.items()
            },
        )

    def _row(self, path: KeyPath, row: Mapping[str, float | str]) -> dict[int, Expression]:
        return {
            self._mode((*path, mode), mode): self.context.compile(
                (*path, mode), probability, self._own, "number"
            )
            for mode, probability in row.items()
        }

    def _mode(self, path: KeyPath, name: str) -> int:
        if name not in self.context.modes:
            raise self.context.document.error(
                path, f"unknown mode {name!r}{suggestion(name, self.context.modes)}"
            )
        return self.context.modes.index(name)

    def __call__(self, name: str, values: Values) -> Capability:
        """The capability called `name`.

        Raises:
            InputError: the parameters make an expression undefined or a distribution wrong.
        """
        known = constants("capability", self.spec.parameters, values, self.context.space)
        external = (
            action.mapped(partial(self._fold, ("capability", "actions", action.name), name, known))
            for action in self.actions
        )
        return Capability(
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            no_entry=self.context.mask(held_locations(values, NO_ENTRY)),
            external=tuple(possible(external)),
            innate=self._fold_innate(name, known),
            processes=self.processes(name, known),
        )

    def _fold(self, path: KeyPath, name: str, known: Constants, expression: Expression) -> Expression:
        try:
            return fold(expression, known)
        except InputError as error:
            raise self.context.document.error(path, f"{error.message} (capability {name})") from error

    def _fold_innate(self, name: str, known: Constants) -> Innate | None:
        template, spec = self.innate, self.spec.innate
        if template is None or spec is None:
            return None
        requires = self._fold(("capability", "innate", "requires"), name, known, template.requires)
        if requires == FALSE:
            return None
        actions = tuple(
            InnateAction(
                action,
                {mode: self._fold_row(action, mode, row, name, known) for mode, row in rows.items()},
            )
            for action, rows in template.actions.items()
        )
        return Innate(
            spec.name,
            template.entry,
            template.initial,
            template.terminal,
            template.restart,
            actions,
            requires,
        )

    def _fold_row(
        self, action: str, mode: int, row: Mapping[int, Expression], name: str, known: Constants
    ) -> dict[int, Fraction]:
        path = ("capability", "innate", "actions", action, self.context.modes[mode])
        folded: dict[int, Fraction] = {}
        for target, expression in row.items():
            place = (*path, self.context.modes[target])
            value = self._fold(place, name, known, expression)
            assert isinstance(value, Constant)
            probability = Fraction(value.value)
            if not 0 <= probability <= 1:
                raise self.context.document.error(
                    place, f"the probability {float(probability):g} is not in [0, 1] (capability {name})"
                )
            if probability > 0:
                folded[target] = probability
        total = sum(folded.values(), Fraction(0))
        if abs(float(total) - 1) > ROW_SUM_TOLERANCE:
            raise self.context.document.error(
                path, f"the probabilities of {action} sum to {float(total):g}, not 1 (capability {name})"
            )
        return folded

    def names_read(self) -> set[str]:
        """Return the resolved names of the parameters that expressions read."""
        found = [*self.processes.expressions]
        for action in self.actions:
            action.mapped(noting(found))
        if self.innate is not None:
            found.append(self.innate.requires)
            rows = [row for rows in self.innate.actions.values() for row in rows.values()]
            found += [expression for row in rows for expression in row.values()]
        return names_in(found)
