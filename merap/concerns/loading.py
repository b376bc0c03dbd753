"""Load a case file step by step, up to the supports of the case study."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from merap.concerns.checks import CHECKED_AT_LOAD, DistributionCheck, check_starts
from merap.concerns.closing import Closing
from merap.concerns.configurations import read_configurations
from merap.concerns.document import Document
from merap.concerns.parameters import Values, find_location
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_capability import NO_ENTRY, CapabilityResolver
from merap.concerns.resolve_environment import BLOCKED, EnvironmentResolver
from merap.concerns.resolve_objective import ObjectiveResolver
from merap.concerns.resolvers import Resolvers
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_objective import ObjectiveSpec
from merap.concerns.supports import Configurations, DeclaredSupports, Support, Supports
from merap.concerns.validation import validate
from merap.concerns.yaml_file import read_document
from merap.errors import InputError
from merap.mdp.model import Bools
from merap.mdp.reserved_names import GOAL_LABEL

CASE_FILE = "case.yaml"
CHECKED_PAIRS = 10_000
REMEMBERED_CELLS = 50_000_000


def read_case(path: Path) -> tuple[Path, Document, CaseSpec]:
    """Read a case file; return its path, its content and the schema's view of it.

    Raises:
        InputError: it can't be read or does not fit the schema.
    """
    file, document = read_document_of(path)
    document = _with_space_file(document, file)
    return file, document, validate(document, CaseSpec)


def read_document_of(path: Path) -> tuple[Path, Document]:
    """Return the path and the content of a case file, given that or its folder.

    Raises:
        InputError: it can't be read.
    """
    file = _case_file(path)
    return file, read_document(file)


def _case_file(path: Path) -> Path:
    try:
        return path / CASE_FILE if path.is_dir() else path
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", source=str(path)) from error


def _with_space_file(document: Document, file: Path) -> Document:
    space = document.data.get("space")
    if not isinstance(space, dict) or set(space) != {"file"} or not isinstance(space["file"], str):
        return document
    with document.at("space", "file"):
        return document.with_mount("space", read_document(file.parent / space["file"]))


def digest(document: Document) -> str:
    """Return the hexadecimal SHA-256 of the case file and the space file."""
    running = hashlib.sha256(document.content)
    for mounted in document.mounts.values():
        running.update(mounted.content)
    return running.hexdigest()


def make_resolvers(context: ResolutionContext, spec: CaseSpec) -> Resolvers:
    """Compile the expressions of the three concerns.

    Raises:
        InputError: an expression, label, mode or action is wrong.
    """
    return Resolvers(
        EnvironmentResolver(context, spec),
        CapabilityResolver(context, spec),
        ObjectiveResolver(context, spec),
    )


def make_supports(context: ResolutionContext, spec: CaseSpec, resolvers: Resolvers) -> DeclaredSupports:
    """Make the configurations of the three concerns; none closes a start location.

    Raises:
        InputError: a concern is empty, a value not allowed or a start closed.
    """
    # Environments come last: `require_reachable` asks for the starts and goals of the objectives.
    objectives = read_configurations(
        context, "objective", spec.objective.parameters, spec.objective.configurations
    )
    capabilities = read_configurations(
        context, "capability", spec.capability.parameters, spec.capability.configurations
    )
    starts = _starts(context, spec.objective, objectives)
    environments = read_configurations(
        context,
        "environment",
        spec.environment.parameters,
        spec.environment.configurations,
        _reachability(spec.objective, objectives, starts, resolvers.environment),
    )
    if BLOCKED in spec.environment.parameters:
        check_starts(context, "environment", environments, BLOCKED, starts)
    if NO_ENTRY in spec.capability.parameters:
        check_starts(context, "capability", capabilities, NO_ENTRY, starts)
    capacity = max(100, REMEMBERED_CELLS // context.space.num_locations)
    return Supports(
        Support(environments, resolvers.environment, capacity),
        Support(capabilities, resolvers.capability, capacity),
        Support(objectives, resolvers.objective, capacity),
    )


def _starts(context: ResolutionContext, spec: ObjectiveSpec, objectives: Configurations) -> set[int]:
    """Return every location where some objective may start."""
    starts: set[int] = set()
    for point in spec.start:
        with context.document.at("objective", "start"):
            if isinstance(point.at, str) and point.at in spec.parameters:
                context.require_location(point.at, spec.parameters)
                found = objectives.locations(point.at)
            else:
                found = {find_location(point.at, context.space)}
        starts |= found if point.probability > 0 else set()
    return starts


def _reachability(
    spec: ObjectiveSpec, objectives: Configurations, starts: set[int], resolver: EnvironmentResolver
) -> Callable[[Sequence[Values]], Bools]:
    goals = objectives.locations(GOAL_LABEL) if GOAL_LABEL in spec.parameters else set()
    return partial(
        resolver.leaves_goals_reachable,
        np.array(sorted(starts), dtype=np.int64),
        np.array(sorted(goals), dtype=np.int64),
    )


def check_at_load(supports: DeclaredSupports, closing: Closing, check_pair: DistributionCheck) -> None:
    """Resolve and check the first configurations of each concern: all of a small support.

    Raises:
        InputError: a configuration can't be resolved, or a distribution does not sum to 1.
    """
    environments = list(islice(supports.environment, CHECKED_AT_LOAD))
    capabilities = list(islice(supports.capability, CHECKED_AT_LOAD))
    deque(islice(supports.objective, CHECKED_AT_LOAD), maxlen=0)  # resolving an objective checks it
    # One environment stands for all that have the same attributes, and the same that capabilities read.
    distinct = list({closing.seen_by_capability(one): one for one in environments}.values())
    pairs = ((environment, capability) for environment in distinct for capability in capabilities)
    for environment, capability in islice(pairs, CHECKED_PAIRS):
        check_pair(*closing.pair(environment, capability))
