"""What a loop does on a family over which no belief is kept: it adapts, and notices no change."""

from __future__ import annotations

from dataclasses import replace

from merap.belief.steps import beyond_places_and_modes
from merap.concerns.case_study import CaseStudy
from merap.concerns.document import KeyPath
from merap.mapek.scenario import Scenario
from merap.strategies.registry import BELIEF, default_strategy
from merap.trigger.settings import NoTriggerSpec


def followable(scenario: Scenario, case: CaseStudy) -> tuple[Scenario, tuple[str, ...]]:
    """Return a scenario as a loop can follow it on a case, and a sentence for each default that differs.

    Raises:
        InputError: it asks for what needs a belief; names the place in the scenario.
    """
    why = beyond_places_and_modes(case.combination_at(0))
    if why is None:
        return scenario, ()
    _refuse_what_needs_a_belief(scenario, f"no belief is kept over {case.name} so far, since {why}")
    spec = scenario.spec
    notices: tuple[str, ...] = ()
    if spec.strategy.name == BELIEF:
        name, notices = default_strategy(case)
        spec = spec.model_copy(update={"strategy": spec.strategy.model_copy(update={"name": name})})
    if spec.trigger.settings is not None:
        spec = spec.model_copy(update={"trigger": NoTriggerSpec(kind="none")})
        notices = (*notices, f"{case.name}: without a belief no change is noticed: the trigger is off")
    return replace(scenario, spec=spec), notices


def _refuse_what_needs_a_belief(scenario: Scenario, why: str) -> None:
    spec = scenario.spec
    asked: tuple[tuple[KeyPath, bool], ...] = (
        (("strategy", "name"), "name" in spec.strategy.model_fields_set and spec.strategy.name == BELIEF),
        (("trigger",), "trigger" in spec.model_fields_set and spec.trigger.settings is not None),
        (("shield",), spec.shield is not None),
        (("learning", "extend"), spec.learning.extend),
    )
    for path, is_asked in asked:
        if is_asked:
            raise scenario.document.error(path, f"this needs a belief, and {why}; leave it out")
