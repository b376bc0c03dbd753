"""Load a case whose models are PRISM text."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from merap.concerns.configurations import read_configurations
from merap.concerns.document import Document
from merap.concerns.expression_names import CONCERNS
from merap.concerns.horizon import check_horizon, horizon_of
from merap.concerns.parameters import Values, present_all
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_program import WrittenCaseSpec
from merap.concerns.space import NO_SPACE
from merap.concerns.supports import Configurations, Support, Supports
from merap.concerns.validation import validate
from merap.errors import InputError, ModelError
from merap.families.prism_family import (
    WrittenCase,
    WrittenConfiguration,
    WrittenObjective,
    WrittenSupports,
    WrittenSystemReader,
)
from merap.families.prism_family_members import ProgramFamily, family_constants, program_family
from merap.families.prism_family_program import OpenProgram
from merap.families.prism_family_texts import read_sources
from merap.mdp.reserved_names import END_ACTION
from merap.mdp.short_repr import ShortRepr
from merap.program.arrays import stuck_state
from merap.program.exploration import explore
from merap.program.expressions import Value
from merap.program.form import ConcernName, Program
from merap.program.names import suggestion
from merap.program.unique_actions import ambiguous_actions

# Members that are explored when a case is loaded, and states after which no further one is.
EXPLORED, EXPLORED_STATES = 16, 200_000


def load_written(file: Path, document: Document) -> WrittenCase:
    """Load a case whose models are PRISM text.

    Args:
        file: the case file.
        document: its content.

    Raises:
        InputError: one clear line with file, line and key.
        EngineError: Storm crashed on a text.
    """
    spec = validate(document, WrittenCaseSpec)
    context = _context(document, spec)
    sources = read_sources(file, document, spec.program)
    configurations = {
        concern: read_configurations(
            context, concern, context.parameters[concern], getattr(spec, concern).configurations
        )
        for concern in CONCERNS
    }
    family = program_family(spec, context, sources, configurations)
    draft = FinishedPrograms(family, frozenset())
    supports = _supports(spec, context, configurations)
    read_system = WrittenSystemReader(
        context=context,
        supports=supports,
        declared=spec.online,
        discount=spec.discount,
        digest=sources.digest,
        actions=(),
        open_programs=draft,
    )
    case = WrittenCase(
        name=spec.case,
        source=file,
        standalone=sources.standalone,
        actions=(),
        discount=spec.discount,
        supports=supports,
        systems={},
        digest=sources.digest,
        warnings=(),
        read_system=read_system,
        open_programs=draft,
    )
    found = explored_sample(case)
    programs = FinishedPrograms(family, found.ambiguous)
    actions = tuple(
        dict.fromkeys(
            action
            for one in family.programs
            for action in one.finished(found.ambiguous).actions
            if action != END_ACTION
        )
    )
    _check_rewarded(spec, context, {*actions, *found.ambiguous})
    read_system = replace(read_system, actions=actions, open_programs=programs)
    return replace(
        case,
        actions=actions,
        open_programs=programs,
        read_system=read_system,
        systems={name: read_system(name, system) for name, system in spec.online.items()},
        warnings=tuple(_warnings(family, found)),
    )


def _context(document: Document, spec: WrittenCaseSpec) -> ResolutionContext:
    """Return what configurations have in common; a case without space has parameters of no location.

    Raises:
        InputError: a parameter is of such a type.
    """
    types = {concern: getattr(spec, concern).parameters for concern in CONCERNS}
    for concern, name, of in (
        (concern, name, of) for concern, own in types.items() for name, of in own.items()
    ):
        if of.kind not in ("number", "bool"):
            raise document.error(
                (concern, "parameters", name), f"a case without space has no parameters of type {of}"
            )
    return ResolutionContext(document, NO_SPACE, (), (), types)


def _supports(
    spec: WrittenCaseSpec, context: ResolutionContext, configurations: Mapping[ConcernName, Configurations]
) -> WrittenSupports:
    horizon = spec.objective.horizon
    check_horizon(context.document, horizon, context.parameters["objective"])

    def configuration(concern: ConcernName, name: str, values: Values) -> WrittenConfiguration:
        shown = present_all(context.parameters[concern], values, NO_SPACE)
        return WrittenConfiguration(name, shown, family_constants(context, concern, values))

    def objective(name: str, values: Values) -> WrittenObjective:
        own = configuration("objective", name, values)
        steps = horizon_of(context.document, horizon, name, values)
        return WrittenObjective(
            name, own.parameters, steps, own.values, properties=dict(spec.objective.properties)
        )

    return Supports(
        Support(configurations["environment"], partial(configuration, "environment")),
        Support(configurations["capability"], partial(configuration, "capability")),
        Support(configurations["objective"], objective),
    )


@dataclass(frozen=True, eq=False, repr=False)
class FinishedPrograms(ShortRepr):
    """The open programs of a family with unique actions; call it with values of parameters.

    Attributes:
        family: its texts.
        ambiguous: actions that are told apart by their commands.
    """

    family: ProgramFamily
    ambiguous: frozenset[str]
    _finished: dict[OpenProgram, Program] = field(default_factory=dict)

    def __call__(self, values: Mapping[str, Value]) -> Program:
        """Return the open program of the text that there is under values of parameters."""
        one = self.family.open_program(values)
        if one not in self._finished:
            self._finished[one] = one.finished(self.ambiguous)
        return self._finished[one]


@dataclass(frozen=True, repr=False)
class ExploredSample(ShortRepr):
    """What the exploration of some members has found.

    Attributes:
        ambiguous: actions of which some state has two commands enabled.
        initial_states: greatest number of initial states that a condition gives; 0: there is no condition.
    """

    ambiguous: frozenset[str]
    initial_states: int


def explored_sample(case: WrittenCase) -> ExploredSample:
    """Explore all members of a small family, or some of a larger one, and check that they are sound.

    Raises:
        InputError: one is not; names the state.
    """
    ambiguous: set[str] = set()
    starts = states = 0
    drawn = (case.combination_at(0), *case.sample(EXPLORED - 1, 0))
    for count, combination in enumerate(drawn, start=1):
        try:
            program = combination.program
            found = explore(program)
            stuck = stuck_state(found)
            if stuck is not None:
                raise ModelError(
                    f"{program.name}: state {stuck} can be reached, is not complete and has no action; where "
                    "that ends the task, write ends_in: '\"deadlock\"'"
                )
        except (InputError, ModelError) as error:
            part = f" (found in {count} of {case.size} combinations)" if count < case.size else ""
            raise InputError(f"{error}{part}", source=str(case.source)) from error
        ambiguous |= ambiguous_actions(found).keys()
        if program.initial_predicate is not None:
            starts = max(starts, int(np.count_nonzero(found.initial)))
        states += len(found.codes)
        if states > EXPLORED_STATES:
            break
    return ExploredSample(frozenset(ambiguous), starts)


def _check_rewarded(spec: WrittenCaseSpec, context: ResolutionContext, known: Collection[str]) -> None:
    """Refuse reward rules for actions that there are not."""
    for place, rule in enumerate(spec.objective.rewards or ()):
        for name in rule.action or ():
            if name not in known:
                raise context.document.error(
                    ("objective", "rewards", place, "action"),
                    f"unknown action {name!r}{suggestion(name, known)}",
                )


def _warnings(family: ProgramFamily, found: ExploredSample) -> Iterator[str]:
    source = family.sources.parts[0].name
    if found.initial_states > 1:
        yield f"{source}: {found.initial_states} initial states, which are equally likely"
    changed = {name: new for one in family.programs for name, new in one.renamed.items()}
    for name, new in changed.items():
        yield f"{source}: {name} is called {new} here, as merap gives {name} another meaning"
    if family.by_value:
        concerns = " and ".join(sorted(family.by_value))
        yield (
            f"program.templates: they ask for the values of parameters of {concerns}, so each configuration "
            "has a program of its own: hypotheses are those of the support only"
        )
