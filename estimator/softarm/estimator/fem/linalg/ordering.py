"""Nested dissection of the node graph by coordinate planes (George 1973)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softarm.estimator.arrays import Floats, Indices

# Nodes that are eliminated together as one dense front.
LEAF = 12
# Quantiles of the nodes along an axis at which a cut is tried.
CUTS = np.linspace(0.15, 0.85, 29)


@dataclass(frozen=True)
class Ordering:
    """An elimination tree of groups of nodes.

    Args:
        order: Nodes in elimination order, shape (free,).
        start: First elimination position of each group, and the end, shape (groups + 1,).
        parent: Parent of each group, -1 at a root; children come before their parent, shape (groups,).
    """

    order: Indices
    start: Indices
    parent: Indices


def adjacency(nodes: int, groups: Sequence[Indices]) -> sparse.csr_matrix:
    """Connect all nodes of each group, shape (nodes, nodes)."""
    graph = sparse.csr_matrix((nodes, nodes), dtype=np.int32)
    for group in groups:
        members = np.broadcast_to(np.arange(len(group))[:, None], group.shape)
        ones = np.ones(group.size, dtype=np.int32)
        incidence = sparse.csr_matrix((ones, (members.ravel(), group.ravel())), shape=(len(group), nodes))
        graph = graph + incidence.T @ incidence
    return graph.tocsr()


def dissect(points: Floats, graph: sparse.csr_matrix, free: Indices) -> Ordering:
    """Order the free nodes so that their elimination fills in little.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        graph: Which nodes are coupled, shape (nodes, nodes).
        free: Nodes to order.
    """
    groups: list[Indices] = []
    parents: list[int] = []

    def visit(nodes: Indices) -> int:
        """Append the subtree of some nodes; return its root."""
        first, second, separator = (
            _bisect(points[nodes], graph[nodes][:, nodes]) if len(nodes) > LEAF else (None,) * 3
        )
        if first is None or second is None or separator is None:
            groups.append(nodes)
            parents.append(-1)
            return len(groups) - 1
        children = [visit(nodes[part]) for part in (first, second) if len(part)]
        groups.append(nodes[separator])
        parents.append(-1)
        for child in children:
            parents[child] = len(groups) - 1
        return len(groups) - 1

    if len(free):
        visit(np.asarray(free))
    sizes = [len(group) for group in groups]
    return Ordering(np.concatenate(groups), np.concatenate([[0], np.cumsum(sizes)]), np.array(parents))


def _bisect(
    points: Floats, graph: sparse.csr_matrix
) -> tuple[Indices, Indices, Indices] | tuple[None, None, None]:
    """Choose among planes the one whose separator is smallest for its balance; None when none divides."""
    best, chosen = np.inf, None
    size = len(points)
    for axis in range(3):
        values = points[:, axis]
        for cut in np.unique(np.quantile(values, CUTS)):
            below = values < cut
            for side, other in ((below, ~below), (~below, below)):
                # The nodes of one side that touch the other; without them the two parts share no entry.
                separator = side & (graph @ other.astype(np.int32) > 0)
                first, second = side & ~separator, other
                smaller = min(first.sum(), second.sum())
                if smaller == 0:
                    continue
                balance = max(first.sum(), second.sum()) / size
                # A small separator counts first; a cut that leaves more than half on one side is charged for
                # it.
                score = separator.sum() * (1.0 + 4.0 * max(balance - 0.5, 0.0) ** 2 * 4.0)
                if score < best:
                    best, chosen = score, (first, second, separator)
    if chosen is None:
        return None, None, None
    first, second, separator = (np.flatnonzero(part) for part in chosen)
    return first, second, separator
