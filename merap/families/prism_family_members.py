"""The open programs of a family of PRISM text: one, or one for each text that its templates give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from math import prod

from merap.checker.prism_model import ConstantType, PrismModel
from merap.concerns.expression_names import CONCERNS
from merap.concerns.parameter_types import ParameterType
from merap.concerns.parameters import Values, constants, parameter_name
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_base import shown
from merap.concerns.schema_program import WrittenCaseSpec
from merap.concerns.supports import Configurations
from merap.errors import InputError
from merap.families.prism_family_program import OpenProgram, open_program
from merap.families.prism_family_texts import PrismText, ProgramSources
from merap.mdp.short_repr import ShortRepr
from merap.prism.user_templates import BranchingError
from merap.program.closing import closed
from merap.program.expressions import Constant, Table, Value, exact, substitute
from merap.program.form import ConcernName, Program
from merap.program.names import suggestion
from merap.program.parameters import parameters

MAX_TEXTS = 256
_FITTING: Mapping[ConstantType, tuple[str, ...]] = {
    "int": ("int", "values"),
    "double": ("int", "real", "probability", "values"),
    "bool": ("bool",),
}


@dataclass(frozen=True, eq=False, repr=False)
class ProgramFamily(ShortRepr):
    """The texts of a case and the programs that they are.

    Attributes:
        spec: the case.
        context: knows the parameters of the concerns; its document is where errors are placed.
        sources: the texts.
        by_value: concerns whose parameters templates need the values of; those of the others stay open.
    """

    spec: WrittenCaseSpec
    context: ResolutionContext
    sources: ProgramSources
    by_value: frozenset[ConcernName] = frozenset()
    _built: dict[PrismText, OpenProgram] = field(default_factory=dict)

    @property
    def programs(self) -> Sequence[OpenProgram]:
        """Those that have been made, in that order."""
        return list(self._built.values())

    @cached_property
    def _constants(self) -> Mapping[str, Value]:
        given = self.spec.program.constants
        return {name: value if isinstance(value, bool) else exact(value) for name, value in given.items()}

    def open_program(self, values: Mapping[str, Value]) -> OpenProgram:
        """Return the program of the text that there is under values of parameters.

        Args:
            values: `<concern>.<name>` -> value.

        Raises:
            BranchingError: a template needs the value of a parameter of another concern than `by_value`.
            InputError: the text is wrong, or does not fit the case.
        """
        known = dict(self._constants)
        open_ = set()
        for concern, types in self.context.parameters.items():
            for name in types:
                if concern in self.by_value:
                    known[name] = values[parameter_name(concern, name)]
                else:
                    open_.add(name)
        text = self.sources.filled(known, frozenset(open_))
        if text not in self._built:
            self._built[text] = self._made(text)
        return self._built[text]

    def _made(self, text: PrismText) -> OpenProgram:
        model = text.read(self.spec.case)
        self._check_constants(text, model)
        given = {name: value for name, value in self._constants.items() if name in model.constants}
        put = {name: Constant(value) for name, value in given.items()}
        model = replace(
            model,
            program=closed(model.program, given),
            definitions={name: substitute(one, put) for name, one in model.definitions.items()},
        )
        made = open_program(model, self._owners(text, model), self.spec.objective, self.context)
        self._check_use(text, model, made.program)
        return made

    def _owners(self, text: PrismText, model: PrismModel) -> Mapping[str, ConcernName]:
        if not text.is_whole:
            return text.owners
        owners: dict[str, ConcernName] = {}
        known = [process.name for process in model.program.processes]
        for concern, modules in self.spec.program.owner.items():
            for name in modules:
                path = ("program", "owner", concern)
                if name not in known:
                    raise self.context.document.error(
                        path, f"the text has no module {name!r}{suggestion(name, known)}"
                    )
                if name in owners:
                    raise self.context.document.error(
                        path, f"the module {name!r} is claimed by {owners[name]} and {concern}"
                    )
                owners[name] = concern
        return owners

    def _check_constants(self, text: PrismText, model: PrismModel) -> None:
        """Refuse open constants that have no value or several, and values of other types."""
        error = self.context.document.error
        for name, of in model.constants.items():
            owners = [concern for concern, types in self.context.parameters.items() if name in types]
            if name in self._constants:
                if owners:
                    raise error(
                        (owners[0], "parameters", name), f"{name!r} has a value in program.constants too"
                    )
                value = self._constants[name]
                if isinstance(value, bool) != (of == "bool") or (
                    of == "int" and Fraction(value).denominator != 1
                ):
                    given = shown(self.spec.program.constants[name])
                    raise error(("program", "constants", name), f"expected a value of type {of}, got {given}")
            elif not owners:
                raise InputError(
                    f"the constant {name!r} has no value: declare it as a parameter of a concern, or give it "
                    "one in program.constants",
                    source=text.parts[0].name,
                )
            elif len(owners) > 1:
                both = " and ".join(owners)
                raise error((owners[1], "parameters", name), f"the constant {name!r} is claimed by {both}")
            else:
                declared = self.context.parameters[owners[0]][name]
                if not _fits(of, declared):
                    raise error(
                        (owners[0], "parameters", name),
                        f"the constant {name!r} is of type {of}, a parameter of type {declared} does not fit",
                    )

    def _check_use(self, text: PrismText, model: PrismModel, program: Program) -> None:
        """Refuse values and parameters that nothing reads, and names that mean something else."""
        error = self.context.document.error
        known = [*model.constants, *self.sources.names]
        for name in self._constants:
            if name not in known:
                raise error(
                    ("program", "constants", name),
                    f"the text has no constant {name!r}{suggestion(name, known)}",
                )
        taken = {*model.definitions, *(one.name for one in program.variables)}
        read = {*parameters(program), parameter_name("objective", str(self.spec.objective.horizon))}
        for concern, types in self.context.parameters.items():
            for name in types:
                path = (concern, "parameters", name)
                if name in taken:
                    raise error(path, f"{name!r} has a meaning in {text.parts[0].name} already")
                if name not in known and parameter_name(concern, name) not in read:
                    raise error(
                        path,
                        f"nothing reads {name!r}: the text has no constant without value of that name"
                        f"{suggestion(name, model.constants)}",
                    )


def _fits(of: ConstantType, declared: ParameterType) -> bool:
    whole = all(isinstance(value, str) or value.denominator == 1 for value in declared.values)
    return declared.name in _FITTING[of] and (of != "int" or whole)


def program_family(
    spec: WrittenCaseSpec,
    context: ResolutionContext,
    sources: ProgramSources,
    configurations: Mapping[ConcernName, Configurations],
) -> ProgramFamily:
    """Return the programs of a case; every text that there is in the support has been read.

    Raises:
        InputError: a text is wrong or does not fit the case, or there are too many.
    """
    family = ProgramFamily(spec, context, sources)
    while True:
        try:
            for values in _deciding(family, configurations):
                family.open_program(values)
        except BranchingError as error:
            owner = next(one for one in CONCERNS if str(error) in context.parameters[one])
            family = replace(family, by_value=family.by_value | {owner})
        else:
            _require_alike(family)
            return family


def _deciding(
    family: ProgramFamily, configurations: Mapping[ConcernName, Configurations]
) -> Iterator[Mapping[str, Value]]:
    """Yield the values of the parameters that decide on the text, those of each configuration."""
    concerns = [one for one in CONCERNS if one in family.by_value]
    counts = [configurations[one].count for one in concerns]
    if prod(counts) > MAX_TEXTS:
        raise InputError(
            f"templates ask for the values of parameters of {' and '.join(concerns)}: that is one text for "
            f"each of {prod(counts)} configurations, at most {MAX_TEXTS} are allowed",
            source=family.context.document.source,
            key="program.templates",
        )
    for indices in product(*map(range, counts)):
        yield {
            name: value
            for concern, index in zip(concerns, indices, strict=True)
            for name, value in family_constants(
                family.context, concern, configurations[concern].values(index)
            ).items()
        }


def family_constants(context: ResolutionContext, concern: ConcernName, values: Values) -> Mapping[str, Value]:
    """Return `<concern>.<name>` -> value of a configuration's parameters."""
    found = constants(concern, context.parameters[concern], values, context.space)
    return {name: value for name, value in found.items() if not isinstance(value, Table)}


def _require_alike(family: ProgramFamily) -> None:
    first, *others = family.programs
    for other in others:
        if [(one.name, one.kind) for one in first.program.variables] != [
            (one.name, one.kind) for one in other.program.variables
        ]:
            raise InputError(
                "the templates declare other variables under some configurations than under others",
                source=family.context.document.source,
                key="program.templates",
            )
