"""Warn about parts of a case file that are allowed but probably not meant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice

from merap.concerns.combination import Capability
from merap.concerns.document import KeyPath, key_text
from merap.concerns.expression_names import CONCERNS
from merap.concerns.location_words import WORDS as LOCATION_WORDS
from merap.concerns.parameters import ParameterTypes, parameter_name
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_objective import ObjectiveResolver
from merap.concerns.resolvers import Resolvers
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_objective import PredicateSpec
from merap.concerns.schema_processes import ANY
from merap.concerns.supports import Support
from merap.program.form import ConcernName

# Capabilities of a large support that are looked at for what they lack.
LOOKED_AT = 1000


def unused_parameters(spec: CaseSpec, resolvers: Resolvers) -> Iterator[str]:
    """A sentence for every parameter that nothing reads."""
    read = {"environment.blocked", "environment.blocked_edges", "environment.locked", "capability.no_entry"}
    read = read.union(*resolvers.names_read().values())
    for concern in CONCERNS:
        for name in getattr(spec, concern).parameters:
            if parameter_name(concern, name) not in read:
                yield f"{concern}.parameters.{name}: nothing reads this parameter"


def numbers_without_domain(parameters: Mapping[ConcernName, ParameterTypes]) -> Iterator[str]:
    """A sentence for every number of which nothing but the values of the support can be supposed."""
    for concern, types in parameters.items():
        for name, of in types.items():
            if of.is_open:
                yield (
                    f"{concern}.parameters.{name}: without a domain only the values of the support are "
                    f"hypotheses; give one as {{{of}: [least, greatest]}}"
                )


def hidden_words(context: ResolutionContext) -> Iterator[str]:
    """A sentence for every declared name that is a word of the case language: the declaration wins."""
    named = [(f"space.attributes.{one.name}", one.name) for one in context.space.attributes]
    named += [(f"{one}.parameters.{name}", name) for one, own in context.parameters.items() for name in own]
    named += [(f"capability.innate.modes.{name}", name) for name in context.modes]
    for place, name in named:
        if name in LOCATION_WORDS:
            yield f"{place}: {name!r} is a word of the case language; expressions read what is declared"
    if ANY in context.actions:
        yield f"capability.actions.{ANY}: changes with action: {ANY} happen with this action alone"


def idle_rules(
    context: ResolutionContext,
    capabilities: Support[Capability],
    resolver: ObjectiveResolver,
    limit: int = LOOKED_AT,
) -> Iterator[str]:
    """A sentence for every rule that names a mode or action which a capability lacks.

    Args:
        context: what the case has in common.
        capabilities: the first `limit` of them are looked at.
        resolver: knows the rules.
        limit: how many to look at.
    """
    lacked: dict[str, str] = {}
    for capability in islice(capabilities, limit):
        present = vocabulary(context, capability)
        for name in (*context.actions, *context.modes):
            if name not in present:
                lacked.setdefault(name, capability.name)
    spec = resolver.spec
    conditions: dict[KeyPath, PredicateSpec | None] = {
        ("rewards", index): rule for index, rule in enumerate(spec.rewards)
    }
    conditions |= {(key,): getattr(spec, key) for key in ("ends_after", "ends_in", "unsafe", "goal")}
    for path, condition in conditions.items():
        for name in sorted(_named(condition) & lacked.keys()):
            yield (
                f"{key_text(('objective', *path))}: names {name!r}, which capability {lacked[name]} lacks: "
                "it never matches there"
            )


def vocabulary(context: ResolutionContext, capability: Capability) -> set[str]:
    """Return the names of the actions and modes that a capability has."""
    names = {action.name for action in capability.external}
    if capability.innate is None:
        return names | {*context.modes[:1]}
    names |= {*context.modes, *(action.name for action in capability.innate.actions)}
    return names | {capability.innate.start_action} if capability.innate.restart else names


def _named(condition: PredicateSpec | None) -> set[str]:
    """Return the actions and modes that a condition names."""
    keys = ("action", "mode", "to_mode")
    return {name for key in keys for name in getattr(condition, key, None) or ()}
