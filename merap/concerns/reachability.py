"""Find the environments that leave goals reachable from starts, many at once."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from merap.concerns.space import Space
from merap.mdp.model import Bools, Ints

CELLS_PER_BLOCK = 2_000_000


def reachable(space: Space, start: int, closed: Bools, closed_edges: Bools | None = None) -> Bools:
    """bool [N, P], the locations that can be reached from `start` in each of N environments.

    One breadth-first search runs over N disjoint copies of the graph, joined by a node that
    leads to every copy's start.

    Args:
        space: P locations, L edge labels.
        start: index of a location; reaches itself even where it is closed.
        closed: bool [N, P], locations nobody can go to.
        closed_edges: bool [N, P, L], edges nobody can use; None: there are none.
    """
    count, places = closed.shape
    assert places == space.num_locations
    source, label = np.nonzero(space.target >= 0)
    target = space.target[source, label]
    is_open = ~closed[:, target]  # [N, E]
    if closed_edges is not None:
        is_open &= ~closed_edges[:, source, label]
    copy, edge = np.nonzero(is_open)
    hub = count * places
    rows = np.concatenate([copy * places + source[edge], np.full(count, hub)])
    cols = np.concatenate([copy * places + target[edge], np.arange(count) * places + start])
    graph = sparse.csr_matrix((np.ones(len(rows), dtype=np.int8), (rows, cols)), shape=(hub + 1, hub + 1))
    found = csgraph.breadth_first_order(graph, hub, directed=True, return_predecessors=False)
    mask = np.zeros(hub + 1, dtype=np.bool_)
    mask[found] = True
    return mask[:-1].reshape(count, places)


def leaves_goals_reachable(
    space: Space, starts: Ints, goals: Ints, closed: Bools, closed_edges: Bools | None = None
) -> Bools:
    """bool [N]: no start is closed and each goal is reachable from each start.

    Args:
        space: P locations, L edge labels.
        starts: int64 [.], indices of locations.
        goals: int64 [.], indices of locations.
        closed: bool [N, P].
        closed_edges: bool [N, P, L] or None.
    """
    keep: Bools = np.logical_not(closed[:, starts].any(axis=1))
    block = max(1, CELLS_PER_BLOCK // max(1, space.target.size))
    for first in range(0, len(closed), block):
        part = slice(first, first + block)
        edges = None if closed_edges is None else closed_edges[part]
        for start in starts.tolist():
            keep[part] &= reachable(space, start, closed[part], edges)[:, goals].all(axis=1)
    return keep
