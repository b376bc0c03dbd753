"""Cases and combinations whose models are PRISM text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination, Configuration, Objective
from merap.concerns.schema import SystemSpec
from merap.concerns.supports import Supports
from merap.concerns.systems import SystemReader
from merap.errors import InputError
from merap.program.closing import closed
from merap.program.expressions import Value
from merap.program.form import Program


@dataclass(frozen=True, eq=False, repr=False)
class WrittenConfiguration(Configuration):
    """A configuration of a concern whose models are PRISM text.

    Attributes:
        values: `<concern>.<parameter>` -> value.
    """

    values: Mapping[str, Value]


@dataclass(frozen=True, eq=False, repr=False)
class WrittenObjective(Objective):
    """A configuration of the objective over PRISM text.

    Attributes:
        values: `objective.<parameter>` -> value.
    """

    values: Mapping[str, Value]


WrittenSupports: TypeAlias = Supports[WrittenConfiguration, WrittenConfiguration, WrittenObjective]
# The open program of a family under some values of parameters: they decide which text it is.
OpenPrograms: TypeAlias = Callable[[Mapping[str, Value]], Program]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WrittenCombination(Combination):
    """A combination whose model is PRISM text.

    Attributes:
        open_programs: of the case.
    """

    environment: WrittenConfiguration
    capability: WrittenConfiguration
    objective: WrittenObjective
    open_programs: OpenPrograms = field(repr=False)

    @cached_property
    def program(self) -> Program:
        """See `Combination`."""
        values = {**self.environment.values, **self.capability.values, **self.objective.values}
        return replace(closed(self.open_programs(values), values), name=self.name)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WrittenCase(CaseStudy[WrittenCombination]):
    """A case whose models are PRISM text.

    Attributes:
        open_programs: text with the objective, before parameters have values.
    """

    supports: WrittenSupports
    open_programs: OpenPrograms = field(repr=False)

    def combine(self, environment: int, capability: int, objective: int) -> WrittenCombination:
        """See `CaseStudy`."""
        parts = (
            self.supports.environment[environment],
            self.supports.capability[capability],
            self.supports.objective[objective],
        )
        return WrittenCombination(
            name=".".join(part.name for part in parts),
            actions=self.actions,
            environment=parts[0],
            capability=parts[1],
            objective=parts[2],
            discount=self.discount,
            digest=self.digest,
            open_programs=self.open_programs,
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WrittenSystemReader(SystemReader):
    """Makes the online systems of a case whose models are PRISM text.

    Attributes:
        actions: of the case.
        open_programs: of the case.
    """

    actions: tuple[str, ...]
    open_programs: OpenPrograms = field(repr=False)

    def __call__(self, name: str, spec: SystemSpec) -> WrittenCombination:
        """See `SystemReader`."""
        self._check_name(name)
        path = self._path(name)
        if spec.start is not None:
            raise self.context.document.error(
                (*path, "start"), "a case without space has no start: episodes begin where the text says"
            )
        objective: WrittenObjective = self._concern(name, "objective", spec)
        if spec.horizon is not None:
            objective = replace(objective, horizon=spec.horizon)
        system = WrittenCombination(
            name=name,
            actions=self.actions,
            environment=self._concern(name, "environment", spec),
            capability=self._concern(name, "capability", spec),
            objective=objective,
            discount=self.discount,
            digest=self.digest,
            reset=spec.reset,
            open_programs=self.open_programs,
        )
        with self.context.document.at(*path):
            unknown = sorted({*system.program.actions} - {*system.action_names})
            if unknown:
                raise InputError(f"the text has the action {unknown[0]} here, which no combination has")
        return system
