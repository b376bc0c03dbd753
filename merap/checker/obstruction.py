"""Explain why a goal can't be reached: name the obstacles between the start and it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import networkx as nx
import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.location_tables import step_scope
from merap.errors import listed
from merap.mdp.model import Bools, Ints
from merap.program.expressions import ZERO, evaluate, variables

MAX_NAMED = 12


def goal_locations(combination: DeclaredCombination) -> Bools:
    """bool [P], where the goal is, whatever else the state is; nowhere if it is not about locations alone."""
    space, goal = combination.space, combination.objective.goal
    nowhere, here = np.zeros(space.num_locations, dtype=np.bool_), np.arange(space.num_locations)
    if goal is None or not space.located:
        return nowhere
    scope = step_scope(space, combination.environment.attributes, here, here)
    if any(variable.name not in scope for variable in variables(goal)):
        return nowhere
    return np.broadcast_to(evaluate(goal, scope), here.shape)


def obstruction(combination: DeclaredCombination) -> str | None:
    """Return the obstacles that cut the goal off from the start in space, in one line; None: there are none.

    It names the blocked locations, no-entry locations, blocked edges and labels without action at
    the border of the region that can be reached, of those that lead on towards the goal.
    """
    space = combination.space
    goals = np.flatnonzero(goal_locations(combination))
    if not len(goals):
        return "the objective declares no goal at a location"
    exists = space.target >= 0
    usable = combination.passable & _has_action(combination)
    reached = _closure(_graph(space.target, usable), np.flatnonzero(combination.objective.start))
    if reached & set(goals.tolist()):
        return None
    # What leads to the goal only through the region itself opens no way to it.
    beyond = _graph(space.target, exists)
    beyond.remove_nodes_from(reached)
    leading = _closure(beyond.reverse(copy=False), goals)
    cut = [
        (source, label)
        for source, label in np.argwhere(exists & ~usable).tolist()
        if source in reached and int(space.target[source, label]) in leading
    ]
    if not cut:
        return f"no edges lead to {_names(space.locations, goals.tolist())}, even with nothing blocked"
    return "cut off by " + "; ".join(_describe(combination, cut))


def _has_action(combination: DeclaredCombination) -> Bools:
    """Return bool [L], whether some external action goes along edges with that label."""
    mask = np.zeros(len(combination.space.moves), dtype=np.bool_)
    for action in combination.capability.external:
        for outcome in action.outcomes:
            if outcome.move is not None and outcome.probability != ZERO:
                mask[outcome.move] = True
    return mask


def _graph(target: Ints, mask: Bools) -> nx.DiGraph[int]:
    graph: nx.DiGraph[int] = nx.DiGraph()
    graph.add_nodes_from(range(len(target)))
    sources, labels = np.nonzero(mask)
    graph.add_edges_from(zip(sources.tolist(), target[sources, labels].tolist(), strict=True))
    return graph


def _closure(graph: nx.DiGraph[int], roots: Ints) -> set[int]:
    found = set(roots.tolist())
    return found.union(*(nx.descendants(graph, root) for root in roots.tolist()))


def _describe(combination: DeclaredCombination, cut: Sequence[tuple[int, int]]) -> list[str]:
    """Return why each of the edges (source, label) can't be used; every obstacle is named once."""
    space, environment, capability = combination.space, combination.environment, combination.capability
    names = space.locations
    blocked, barred, edges, lacking = set(), set(), [], set()
    for source, label in cut:
        target = int(space.target[source, label])
        if environment.blocked[target]:
            blocked.add(target)
        elif capability.no_entry[target]:
            barred.add(target)
        elif environment.blocked_edges[source, label]:
            edges.append(f"{names[source]} to {names[target]}")
        else:
            lacking.add(space.moves[label])
    parts = []
    if blocked:
        parts.append(f"blocked {_names(names, blocked)} (environment {environment.name})")
    if barred:
        parts.append(f"no entry to {_names(names, barred)} (capability {capability.name})")
    if edges:
        distinct = list(dict.fromkeys(edges))  # several labels may lead from one location to another
        parts.append(f"blocked edges {listed(distinct, MAX_NAMED)} (environment {environment.name})")
    if lacking:
        parts.append(f"no action goes {listed(sorted(lacking), MAX_NAMED)} (capability {capability.name})")
    return parts


def _names(locations: Sequence[str], indices: Collection[int]) -> str:
    return listed([locations[index] for index in sorted(indices)], MAX_NAMED)
