"""Whether the strategy of a scenario is one for a loop, and can learn in the episodes that there are."""

from __future__ import annotations

from collections.abc import Container

from merap.errors import InputError
from merap.mapek.scenario import Scenario
from merap.strategies.registry import ORACLE, PRETRAINED, episodes_per_update, parse_strategy


def require_strategy(scenario: Scenario, combinations: Container[str]) -> None:
    """Refuse a strategy that a loop can't have, before anything is learned or simulated.

    Args:
        scenario: names the strategy.
        combinations: of the run's base.

    Raises:
        InputError: there is no such strategy, it is none for a loop, or there are too few episodes for one
            policy update; names the place in the scenario.
    """
    spec = scenario.spec.strategy
    with scenario.document.at("strategy", "name"):
        kind, argument = parse_strategy(spec.name)
        if kind == ORACLE:
            raise InputError(
                "'oracle' needs the true model, which no loop is told, not even of a simulated system; "
                "the report has its value as the optimum"
            )
        if kind == PRETRAINED and argument not in combinations:
            raise InputError(f"the base has no combination {argument!r} to play the policy of")
        needed = episodes_per_update(spec.name, spec.episodes_per_step)
    if needed > scenario.spec.episodes:
        raise scenario.document.error(
            ("strategy", "episodes_per_step"),
            f"a policy update of {kind!r} takes {needed} episodes, but the scenario has "
            f"{scenario.spec.episodes}; give fewer episodes_per_step, or more episodes",
        )
