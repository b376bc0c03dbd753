"""Read the `configurations` of the case file, named or generated."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from merap.concerns.document import KeyPath
from merap.concerns.generation import Choice, Product, draw, separators
from merap.concerns.parameter_types import ParameterType
from merap.concerns.parameters import (
    ParameterTypes,
    Values,
    find_doors,
    find_edges,
    find_locations,
    parse_location_set,
    parse_value,
)
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.schema_base import shown
from merap.concerns.schema_configurations import ChoiceSpec, GeneratedSpec, NamedSpec
from merap.concerns.space import Space
from merap.concerns.supports import Configurations, Generated, Named
from merap.errors import InputError
from merap.mdp.model import Bools, Ints
from merap.program.names import check_name, suggestion

MAX_COUNT = 2**62
MAX_ENUMERATED = 200_000
MAX_DRAWN_PER_KEPT = 1000
# Values of one parameter that are listed to range over all of them.
MAX_LISTED = 1_000_000
ALL = "all"
BLOCK = 4096

Filter: TypeAlias = Callable[[Sequence[Values]], Bools]


def read_configurations(
    context: ResolutionContext,
    concern: str,
    types: ParameterTypes,
    spec: GeneratedSpec | NamedSpec,
    reachable: Filter | None = None,
) -> Configurations:
    """The configurations of a concern.

    Args:
        context: what the case has in common.
        concern: `environment`, `capability` or `objective`.
        types: the concern's parameters.
        spec: as validated.
        reachable: for `require_reachable`: which of some values to keep; None: not allowed here.

    Raises:
        InputError: no configuration, or a value that is not allowed.
    """
    path = (concern, "configurations")
    configurations: Configurations
    if isinstance(spec, GeneratedSpec):
        configurations = _generated(context, path, types, spec, reachable)
    else:
        configurations = _named(context, path, types, spec)
    if configurations.count == 0:
        raise context.document.error(
            path, f"empty concern: {concern} has no configuration, at least one is needed"
        )
    return configurations


def _named(context: ResolutionContext, path: KeyPath, types: ParameterTypes, spec: NamedSpec) -> Named:
    listed = []
    for name, raw in spec.items():
        with context.document.at(*path, name):
            check_name(name, "a configuration")
        listed.append(read_values(context, (*path, name), types, raw))
    return Named(tuple(spec), tuple(listed))


def read_values(
    context: ResolutionContext, path: KeyPath, types: ParameterTypes, raw: Mapping[str, Any]
) -> Values:
    """Canonical values of all parameters from a mapping of the file.

    Raises:
        InputError: a parameter is unknown or has no value, or a value is wrong.
    """
    _check_parameters(context, path, types, raw)
    values = {}
    for name, of in types.items():
        with context.document.at(*path, name):
            values[name] = parse_value(of, raw[name], context.space)
    return values


def _check_parameters(
    context: ResolutionContext, path: KeyPath, types: ParameterTypes, given: Mapping[str, Any]
) -> None:
    for name in given:
        if name not in types:
            raise context.document.error(
                (*path, name), f"unknown parameter {name!r}{suggestion(name, types)}"
            )
    for name in types:
        if name not in given:
            raise context.document.error(path, f"the parameter {name!r} has no value")


def _generated(
    context: ResolutionContext,
    path: KeyPath,
    types: ParameterTypes,
    spec: GeneratedSpec,
    reachable: Filter | None,
) -> Generated:
    if spec.require_reachable and reachable is None:
        raise context.document.error(
            (*path, "require_reachable"), "require_reachable belongs to the configurations of the environment"
        )
    product = _product(context, (*path, "generate"), types, spec)
    keep = reachable if spec.require_reachable else None
    if spec.sample is not None:
        with context.document.at(*path, "sample"):
            return Generated(product, _sampled(product, spec.sample, np.random.default_rng(spec.seed), keep))
    if keep is None:
        return Generated(product)
    if product.count > MAX_ENUMERATED:
        raise context.document.error(
            (*path, "require_reachable"),
            f"{product.count} configurations are too many to check, the limit is {MAX_ENUMERATED}; "
            "add sample: n",
        )
    everything = product.all_values()
    blocks = iter(lambda: list(itertools.islice(everything, BLOCK)), [])
    mask = [keep(block) for block in blocks]
    return Generated(product, np.flatnonzero(np.concatenate(mask)) if mask else np.zeros(0, dtype=np.int64))


def _sampled(product: Product, count: int, generator: np.random.Generator, keep: Filter | None) -> Ints:
    """Rising ranks of `count` distinct configurations that `keep` accepts."""
    if count > product.count:
        raise InputError(f"a sample of {count} is more than the {product.count} configurations there are")
    found: list[int] = []
    drawn = 0
    for block in draw(product.count, count, generator):
        for start in range(0, len(block), BLOCK):
            ranks = block[start : start + BLOCK]
            drawn += len(ranks)
            accepted = ranks if keep is None else ranks[keep([product.values(int(r)) for r in ranks])]
            found.extend(accepted.tolist())
            if len(found) >= count:
                return np.sort(np.array(found[:count], dtype=np.int64))
        if drawn > MAX_DRAWN_PER_KEPT * count:
            break
    raise InputError(f"only {len(found)} of {drawn} configurations drawn leave every goal reachable")


def _product(
    context: ResolutionContext, path: KeyPath, types: ParameterTypes, spec: GeneratedSpec
) -> Product:
    _check_parameters(context, path, types, spec.generate)
    pools = {}
    for name, of in types.items():
        choice = spec.generate[name]
        _check_choice(context, (*path, name), of, choice)
        members = _members(context, (*path, name), of, choice)
        pools[name] = {member: _label(context, of, member) for member in members}
    labels = [label for pool in pools.values() for label in pool.values()]
    with context.document.at(*path):
        inner, outer = separators(labels)
        for name, pool in pools.items():
            if len(set(pool.values())) < len(pool):
                raise InputError(f"the values of {name!r} can't be told apart by name")
    product = Product(
        tuple(
            Choice(name, tuple(pool), tuple(pool.values()), _sizes(spec.generate[name]), inner)
            for name, pool in pools.items()
        ),
        outer,
    )
    if product.count > MAX_COUNT:
        raise context.document.error(
            path, f"{float(product.count):.3g} configurations, at most {MAX_COUNT} are allowed"
        )
    return product


def _sizes(choice: ChoiceSpec) -> range | None:
    if choice.choose is None:
        return None
    return range(choice.choose if choice.distinct else 1, choice.choose + 1)


def _check_choice(context: ResolutionContext, path: KeyPath, of: ParameterType, choice: ChoiceSpec) -> None:
    if of.is_set and choice.choose is None:
        raise context.document.error(path, f"key 'choose' is missing: how many {of} to choose")
    if not of.is_set and choice.choose is not None:
        raise context.document.error((*path, "choose"), f"choose is for sets, as locations, not for {of}")
    if choice.choose is None and not choice.distinct:
        raise context.document.error((*path, "distinct"), "distinct goes with choose")


def _members(
    context: ResolutionContext, path: KeyPath, of: ParameterType, choice: ChoiceSpec
) -> tuple[Any, ...]:
    with context.document.at(*path, "from"):
        members = _pool(context, of, choice.source)
        for member, times in Counter(members).items():
            if times > 1:
                raise InputError(f"{_label(context, of, member)} stands twice")
    with context.document.at(*path, "except"):
        without = set(_pool(context, of, choice.without))
    members = tuple(member for member in members if member not in without)
    if not members or (choice.choose or 0) > len(members):
        raise context.document.error(
            path, f"empty concern: {choice.choose or 1} can't be chosen from {len(members)} members"
        )
    return members


def _pool(context: ResolutionContext, of: ParameterType, source: Any) -> tuple[Any, ...]:
    """Return values, or members of sets, in the order in which the file lists them."""
    space = context.space
    everything = source == ALL and ALL not in space.location_index
    if of.holds_locations:
        if everything:
            return tuple(range(space.num_locations))
        return find_locations(parse_location_set(source), space)
    if of.name == "doors":
        return tuple(range(len(space.doors))) if everything else find_doors(source, space)
    if everything:
        return tuple(_all_edges(space) if of.is_set else of.numbers(MAX_LISTED))
    if not isinstance(source, tuple):
        raise InputError(f"expected a list of values, or all, got {shown(source)}")
    if of.is_set:
        return tuple(_one_edge(context, entry) for entry in source)
    return tuple(of.parse(entry) for entry in source)


def _all_edges(space: Space) -> list[tuple[int, int]]:
    sources, labels = np.nonzero(space.target >= 0)
    return list(zip(sources.tolist(), labels.tolist(), strict=True))


def _one_edge(context: ResolutionContext, entry: Any) -> tuple[int, int]:
    edges = find_edges(entry, context.space)
    if len(edges) > 1:
        raise InputError(f"{shown(entry)} names {len(edges)} edges; add the label")
    return edges[0]


def _label(context: ResolutionContext, of: ParameterType, member: Any) -> str:
    """The part of a configuration's name that stands for a member."""
    space = context.space
    if of.holds_locations:
        return str(space.locations[member])
    if of.name == "doors":
        return str(space.doors[member].name)
    if of.is_set:
        source, label = member
        return f"{space.locations[source]}_{space.moves[label]}"
    value = of.present(member)
    if isinstance(value, bool):
        return "true" if value else "false"
    return (
        value if isinstance(value, str) else repr(value).replace("-", "m").replace("+", "").replace(".", "p")
    )
