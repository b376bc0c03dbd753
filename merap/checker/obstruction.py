"""Why a goal can't be reached: what stands between the start and it."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np

from merap.concerns.combination import Combination
from merap.mdp.model import Bools

MAX_NAMED = 12


def obstruction(combination: Combination) -> str | None:
    """What cuts the goal off from the start in space; None if nothing does.

    Names the blocked locations, no-entry locations and blocked edges at the border of the
    region that can be reached, of those that lead on towards the goal.
    """
    space = combination.space
    goals = np.flatnonzero(combination.objective.goal)
    starts = np.flatnonzero(combination.objective.start)
    if not len(goals):
        return "the objective declares no goal"
    everything = _graph(space.target, space.target >= 0)
    reached = _closure(_graph(space.target, combination.passable), starts)
    if reached & set(goals.tolist()):
        return None
    leading = _closure(everything.reverse(copy=False), goals)
    border = (space.target >= 0) & ~combination.passable
    sources, labels = np.nonzero(border)
    cut = [
        (source, int(space.target[source, label]), bool(combination.environment.blocked_edges[source, label]))
        for source, label in zip(sources.tolist(), labels.tolist(), strict=True)
        if source in reached and int(space.target[source, label]) in leading
    ]
    if not cut:
        return f"no edges lead to {_names(space.locations, goals.tolist())}, even with nothing blocked"
    return "cut off by " + "; ".join(_describe(combination, cut))


def _graph(target: np.ndarray, mask: Bools) -> nx.DiGraph:
    graph = nx.DiGraph()
    graph.add_nodes_from(range(len(target)))
    sources, labels = np.nonzero(mask)
    graph.add_edges_from(zip(sources.tolist(), target[sources, labels].tolist(), strict=True))
    return graph


def _closure(graph: nx.DiGraph, roots: np.ndarray) -> set[int]:
    found = set(roots.tolist())
    return found.union(*(nx.descendants(graph, root) for root in roots.tolist()))


def _describe(combination: Combination, cut: Sequence[tuple[int, int, bool]]) -> list[str]:
    locations = combination.space.locations
    targets = {target for _, target, _ in cut}
    blocked = [target for target in targets if combination.environment.blocked[target]]
    barred = [target for target in targets if combination.capability.no_entry[target]]
    edges = [f"{locations[source]} to {locations[target]}" for source, target, is_edge in cut if is_edge]
    parts = []
    if blocked:
        parts.append(f"blocked {_names(locations, blocked)} (environment {combination.environment.name})")
    if barred:
        parts.append(f"no entry to {_names(locations, barred)} (capability {combination.capability.name})")
    if edges:
        parts.append(f"blocked edges {_shortened(edges)} (environment {combination.environment.name})")
    return parts


def _names(locations: Sequence[str], indices: Sequence[int]) -> str:
    return _shortened([locations[index] for index in sorted(indices)])


def _shortened(names: list[str]) -> str:
    rest = len(names) - MAX_NAMED
    return ", ".join(names[:MAX_NAMED]) + (f" and {rest} more" if rest > 0 else "")
