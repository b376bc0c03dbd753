"""Warn about parts of a case file that are allowed but probably not meant."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from merap.concerns.combination import Capability
from merap.concerns.document import key_text
from merap.concerns.expression_names import CONCERNS
from merap.concerns.parameters import parameter_name
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_objective import ConditionTemplate, ObjectiveResolver
from merap.concerns.resolvers import Resolvers
from merap.concerns.schema import CaseSpec
from merap.concerns.supports import Support

# Capabilities of a large support that are looked at for what they lack.
LOOKED_AT = 1000


def unused_parameters(spec: CaseSpec, resolvers: Resolvers) -> Iterator[str]:
    """A sentence for every parameter that nothing reads."""
    read = {
        "environment.blocked",
        "environment.blocked_edges",
        "environment.locked",
        "capability.no_entry",
        "objective.goal",
    }
    read = read.union(*resolvers.names_read().values())
    for concern in CONCERNS:
        for name in getattr(spec, concern).parameters:
            if parameter_name(concern, name) not in read:
                yield f"{concern}.parameters.{name}: nothing reads this parameter"


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
    for template in resolver.templates:
        for name in sorted(_named(context, template) & lacked.keys()):
            yield (
                f"{key_text(template.path)}: names {name!r}, which capability {lacked[name]} lacks: "
                "it never matches there"
            )


def vocabulary(context: ResolutionContext, capability: Capability) -> set[str]:
    """Return the names of the actions and modes that a capability has."""
    names = {action.name for action in capability.external}
    if capability.innate is None:
        return names | {*context.modes[:1]}
    names |= {*context.modes, *(action.name for action in capability.innate.actions)}
    return names | {capability.innate.start_action} if capability.innate.restart else names


def _named(context: ResolutionContext, template: ConditionTemplate) -> set[str]:
    names = set(template.actions or ())
    for mask in (template.modes, template.to_modes):
        if mask is not None:
            names |= {context.modes[mode] for mode in np.flatnonzero(mask)}
    return names
