"""Say what a case consists of, and what a model's best policy does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

from merap.cli.output import counted, number, say, table
from merap.concerns.case_study import CaseStudy, DeclaredCase
from merap.concerns.combination import Combination, Configuration
from merap.concerns.parameters import ParameterTypes
from merap.concerns.supports import Support

if TYPE_CHECKING:
    from merap.mdp.model import TabularMDP
    from merap.report.decisions import Decisions

MOST_CONFIGURATIONS, MOST_DECISIONS = 10, 40
_LISTED = 8


def summary(study: CaseStudy) -> str:
    """Return one line: name, sizes, online systems."""
    parts = [(len(study.actions), "action")]
    if isinstance(study, DeclaredCase) and study.space.located:
        parts.insert(0, (study.space.num_locations, "location"))
    return (
        f"{study.name}: {', '.join(counted(*part) for part in parts)}; {counted(study.size, 'combination')} "
        f"of {' x '.join(map(str, study.shape))} configurations; "
        f"online systems: {', '.join(study.systems) or 'none'}"
    )


def say_case(study: CaseStudy) -> None:
    """Print actions, discount, and the configurations of each concern with their parameters."""
    say(summary(study))
    say(f"actions: {', '.join(study.actions)}; discount {number(study.discount)}")
    supports, types = study.supports, study.read_system.context.parameters
    _say_support("environment", types["environment"], supports.environment)
    _say_support("capability", types["capability"], supports.capability)
    _say_support("objective", types["objective"], supports.objective)


def _say_support(concern: str, types: ParameterTypes, support: Support[Any]) -> None:
    """Print a table: a configuration in each row, a parameter with its type in each column."""
    shown: list[Configuration] = list(islice(support, MOST_CONFIGURATIONS))
    table(
        (concern, *(f"{name}: {types[name].text}" for name in shown[0].parameters)),
        ((one.name, *(value_text(value) for value in one.parameters.values())) for one in shown),
    )
    if support.count > len(shown):
        say(f"... and {support.count - len(shown)} more")


def say_system(combination: Combination, model: TabularMDP) -> None:
    """Print the parameters of a system, its horizon, and the size of its model."""
    concerns = (combination.environment, combination.capability, combination.objective)
    values = [f"{name}={value_text(value)}" for one in concerns for name, value in one.parameters.items()]
    say(f"{combination.name}: {', '.join(values) or 'no parameters'}")
    sizes = (
        (combination.objective.horizon, "step"),
        (model.num_states, "state"),
        (model.num_choices, "choice"),
        (model.num_branches, "transition"),
    )
    say(f"horizon {', '.join(counted(*size) for size in sizes)}")


def say_decisions(found: Decisions) -> None:
    """Print the actions of a policy by state; boxes of states are one row."""
    table((*found.variables, "action"), found.rows[:MOST_DECISIONS])
    if len(found.rows) > MOST_DECISIONS:
        say(f"... and {len(found.rows) - MOST_DECISIONS} more rows")


def value_text(value: Any) -> str:
    """Return the value of a parameter, a long list shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return number(value)
    if isinstance(value, Mapping):
        return " ".join(f"{key} {value_text(one)}" for key, one in value.items())
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_listed(value)) + "]"
    return str(value)


def _listed(values: list[Any] | tuple[Any, ...]) -> Iterator[str]:
    yield from map(value_text, values[:_LISTED])
    if len(values) > _LISTED:
        yield f"... {len(values) - _LISTED} more"
