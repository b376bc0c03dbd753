"""Resolve configurations of the capability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from merap.concerns.closing import names_in_part, with_values
from merap.concerns.combination import Capability
from merap.concerns.document import KeyPath
from merap.concerns.expression_names import CONCERNS
from merap.concerns.external_action import ExternalAction, Outcome, Sets
from merap.concerns.innate import Innate, InnateAction
from merap.concerns.parameters import Values, constants, held_locations, present_all
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_changes import ChangeReader
from merap.concerns.resolve_processes import process_entries, resolve_processes
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_capability import STAY, ActionSpec, InnateSpec, OutcomeSpec, restarts
from merap.concerns.schema_processes import SetSpec
from merap.mdp.model import ROW_SUM_TOLERANCE
from merap.program.expressions import ONE, Expression, Operation
from merap.program.form import StateVariable
from merap.program.names import suggestion

NO_ENTRY = "no_entry"


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
        self.template = Capability(
            name="",
            parameters={},
            no_entry=context.mask(()),
            external=tuple(self._action(name, entry) for name, entry in spec.actions.items()),
            innate=None if spec.innate is None else self._innate(spec.innate),
            processes=resolve_processes(context, process_entries(case, "capability")),
        )

    def _action(self, name: str, spec: ActionSpec) -> ExternalAction:
        path = ("capability", "actions", name)
        if spec.outcomes is not None:
            outcomes = self._listed_outcomes((*path, "outcomes"), spec.outcomes)
        elif spec.move is not None:
            outcomes = self._move_or_otherwise(path, spec.move, spec)
        else:
            outcomes = (Outcome(None, ONE),)
        requires, sets = self._requires(path, spec.requires), self._sets((*path, "sets"), spec.sets)
        return ExternalAction(name, outcomes, spec.on_blocked, requires, sets)

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

    def _innate(self, spec: InnateSpec) -> Innate:
        path = ("capability", "innate")
        terminal = spec.terminal or spec.modes
        actions = (
            InnateAction(action, self._rows((*path, "actions", action), rows))
            for action, rows in spec.actions.items()
        )
        mode = self.context.mode
        return Innate(
            name=spec.name,
            entry=0 if spec.entry is None else mode((*path, "entry"), spec.entry),
            initial=0 if spec.initial is None else mode((*path, "initial"), spec.initial),
            terminal=frozenset(mode((*path, "terminal", place), one) for place, one in enumerate(terminal)),
            restart=restarts(spec),
            actions=tuple(actions),
            requires=self._requires(path, spec.requires),
        )

    def _rows(
        self, path: KeyPath, rows: Mapping[str, Mapping[str, float | str]]
    ) -> dict[int, dict[int, Expression]]:
        """The automaton is the system's alone: its probabilities read parameters of the capability."""
        names = self.context.names("capability", of_state=False, foreign=False)
        return {
            self.context.mode((*path, mode), mode): {
                self.context.mode((*path, mode, successor), successor): self.context.compile(
                    (*path, mode, successor), probability, names, "number"
                )
                for successor, probability in row.items()
            }
            for mode, row in rows.items()
        }

    def _requires(self, path: KeyPath, given: bool | str) -> Expression:
        return self.context.compile((*path, "requires"), given, self.context.names("capability"), "bool")

    def __call__(self, name: str, values: Values) -> Capability:
        """The capability called `name`.

        Raises:
            InputError: the parameters make an expression undefined or a distribution wrong.
        """
        document, whose = self.context.document, f"capability {name}"
        known = constants("capability", self.spec.parameters, values, self.context.space)
        found = replace(
            self.template,
            name=name,
            parameters=present_all(self.spec.parameters, values, self.context.space),
            known=known,
            no_entry=self.context.mask(held_locations(values, NO_ENTRY)),
        )
        found = with_values(document, found, known, whose)
        for action in found.innate.actions if found.innate is not None else ():
            self._check_rows(action, whose)
        return found

    def _check_rows(self, action: InnateAction, whose: str) -> None:
        document, modes = self.context.document, self.context.modes
        for mode, row in action.chances.items():
            path = ("capability", "innate", "actions", action.name, modes[mode])
            for successor, chance in row.items():
                if not 0 <= chance <= 1:
                    message = f"the probability {float(chance):g} is not in [0, 1] ({whose})"
                    raise document.error((*path, modes[successor]), message)
            total = float(sum(row.values()))
            if abs(total - 1) > ROW_SUM_TOLERANCE:
                message = f"the probabilities of {action.name} sum to {total:g}, not 1 ({whose})"
                raise document.error(path, message)

    def names_read(self) -> set[str]:
        """Return the resolved names of the parameters that expressions read."""
        return names_in_part(self.template)
