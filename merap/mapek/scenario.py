"""A scenario: a system, and its changes with their moments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

from merap.concerns.arguments import as_path
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.concerns.document import Document, KeyPath
from merap.concerns.schema import SystemSpec
from merap.concerns.validation import validate
from merap.concerns.yaml_file import read_document
from merap.errors import InputError
from merap.mapek.scenario_schema import CONCERNS, ChangeSpec, LiveSpec, ScenarioSpec
from merap.masking import masked_data
from merap.program.names import check_name, suggestion


@dataclass(frozen=True, order=True)
class Moment:
    """A moment: a number of steps of an episode; both count from 0."""

    episode: int
    step: int = 0


@dataclass(frozen=True, eq=False)
class Stage:
    """A system that is in force from a moment on.

    Attributes:
        begins: the moment.
        changed: the concerns that differ from the stage before; empty for the first.
        system: the combination in force.
    """

    begins: Moment
    changed: tuple[str, ...]
    system: Combination


@dataclass(frozen=True, eq=False)
class Scenario:
    """A scenario file.

    Attributes:
        spec: its content.
        document: the file, for messages.
    """

    spec: ScenarioSpec
    document: Document = field(repr=False)

    def settings(self) -> dict[str, Any]:
        """Return all settings as JSON has them, defaults included; secrets of a live system are masked."""
        settings = self.spec.model_dump(mode="json", warnings=False)
        return settings if self.spec.live is None else {**settings, "system": masked_data(settings["system"])}

    def stages(self, case: CaseStudy) -> tuple[Stage, ...]:
        """Return the stages in order.

        Raises:
            InputError: the case has no such configuration, a system is impossible, or it is not simulated;
                names the place in the scenario.
        """
        spec = self._first(case)
        stages = [Stage(Moment(0), (), self._read(case, spec, 0, ("system",)))]
        horizon = stages[0].system.objective.horizon
        for index, change in enumerate(self.spec.changes):
            path: KeyPath = ("changes", index)
            if change.at.step >= horizon:
                raise self.document.error(
                    (*path, "at", "step"), f"an episode has {horizon} steps, got {change.at.step}"
                )
            spec = spec.model_copy(update=_changes(change, stages[-1].system))
            system = self._read(case, spec, index + 1, path)
            moment = Moment(change.at.episode, change.at.step)
            stages.append(Stage(moment, _changed(stages[-1].system, system), system))
        return tuple(stages)

    def _first(self, case: CaseStudy) -> SystemSpec:
        given = self.spec.system
        if isinstance(given, LiveSpec):
            raise self.document.error(("system",), "the system is not simulated; expected one of the case")
        if isinstance(given, SystemSpec):
            return given
        if given in case.online:
            return case.online[given]
        with self.document.at("system"):
            combination = _known(case, given)
        return SystemSpec(**{concern: getattr(combination, concern).name for concern in CONCERNS})

    def _read(self, case: CaseStudy, spec: SystemSpec, number: int, path: KeyPath) -> Combination:
        with self.document.at(*path):
            return case.met(f"stage_{number}", spec, self.document, path)

    def action(self, case: CaseStudy) -> int | None:
        """Return the number of the fallback action; None if none is declared.

        Raises:
            InputError: the case has no such action.
        """
        name = self.spec.deadline.fallback
        if name is None:
            return None
        if name not in case.actions:
            raise self.document.error(
                ("deadline", "fallback"), f"unknown action {name!r}{suggestion(name, case.actions)}"
            )
        return case.actions.index(name)


def _known(case: CaseStudy, name: str) -> Combination:
    try:
        return case.combination(name)
    except InputError as error:
        # without the case file's name: the mistake is in the scenario
        raise InputError(error.message) from error


def _changes(change: ChangeSpec, before: Combination) -> dict[str, Any]:
    """Return concern -> a configuration's name, or values; a parameter that is not named keeps its value."""
    given = {concern: getattr(change, concern) for concern in CONCERNS}
    return {
        concern: {**getattr(before, concern).parameters, **value} if isinstance(value, Mapping) else value
        for concern, value in given.items()
        if value is not None
    }


def _changed(before: Combination, after: Combination) -> tuple[str, ...]:
    """Return the concerns whose parameters have other values."""

    def differs(concern: str) -> bool:
        return bool(getattr(before, concern).parameters != getattr(after, concern).parameters)

    return tuple(concern for concern in CONCERNS if differs(concern))


def as_scenario(value: Scenario | str | PathLike[str]) -> Scenario:
    """Return a scenario, read if the path of its file is given.

    Raises:
        InputError: it is neither, or the file is wrong.
    """
    return value if isinstance(value, Scenario) else read_scenario(value)


def read_scenario(path: str | PathLike[str]) -> Scenario:
    """Read a scenario file.

    Raises:
        InputError: one clear line with file, line and key.
    """
    document = read_document(as_path(path, "scenario"))
    spec = validate(document, ScenarioSpec)
    with document.at("scenario"):
        check_name(spec.scenario, "a scenario")
    return Scenario(spec, document)
