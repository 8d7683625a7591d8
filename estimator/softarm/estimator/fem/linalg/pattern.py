"""Where each 3 x 3 block of the tangent stiffness is stored.

Only the blocks of the lower triangle are kept, column by column, free nodes in elimination order. Two arrays
of blocks hold a tangent: ``values[k]`` is the block (row, column) and ``mirror[k]`` the transpose of the
block (column, row); they are equal when the tangent is symmetric.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from softarm.estimator.arrays import Floats, Indices

Slots = NDArray[np.int32]
# Stands for a held node, among places and among slots.
FIXED = -1


@dataclass(frozen=True)
class Pattern:
    """Block pattern of the lower triangle over the free nodes.

    Args:
        free_nodes: Mesh node of each free node, in elimination order, shape (free,).
        place: Free index of each mesh node, -1 when it is held, shape (nodes,).
        column_start: First slot of each block column, shape (free + 1,).
        row: Block row of each slot; the first of each column is the diagonal, shape (slots,).
    """

    free_nodes: Indices
    place: Indices
    column_start: Indices
    row: Indices

    @property
    def free(self) -> int:
        """Number of free nodes."""
        return len(self.free_nodes)

    @property
    def slots(self) -> int:
        """Number of stored blocks."""
        return len(self.row)

    @property
    def column(self) -> Indices:
        """Block column of each slot, shape (slots,)."""
        return np.repeat(np.arange(self.free), np.diff(self.column_start))

    def locate(self, groups: Indices) -> Slots:
        """Find the slot of every ordered pair of nodes of each group.

        Args:
            groups: Mesh nodes that are coupled, shape (groups, nodes).

        Returns:
            Shape (groups, nodes, nodes): the slot k >= 0 where (first, second) lies in the lower triangle,
            -2 - k where its transpose does, -1 where a node is held.
        """
        place = self.place[groups]
        first, second = np.broadcast_arrays(place[:, :, None], place[:, None, :])
        low, high = np.minimum(first, second), np.maximum(first, second)
        keys = self.column * self.free + self.row
        # Slots ascend by column, then row, so that one number finds each; held nodes are masked afterwards.
        index = np.searchsorted(keys, np.maximum(low, 0) * self.free + np.maximum(high, 0))
        slots = np.where(first >= second, index, -2 - index)
        return np.where(low < 0, FIXED, slots).astype(np.int32)

    def gather(self, nodal: Floats) -> Floats:
        """Pick the free part of nodal vectors, shape (..., nodes, 3) to (..., 3 free)."""
        free = np.take(nodal, self.free_nodes, axis=-2)
        return free.reshape(*free.shape[:-2], free.shape[-2] * free.shape[-1])

    def scatter(self, free: Floats) -> Floats:
        """Fill nodal vectors with zeros at held nodes, shape (..., 3 free) to (..., nodes, 3)."""
        nodal = np.zeros((*free.shape[:-1], len(self.place), 3))
        nodal[..., self.free_nodes, :] = free.reshape(*free.shape[:-1], len(self.free_nodes), 3)
        return nodal

    def matrix(self, values: Floats, mirror: Floats) -> sparse.csc_matrix:
        """Assemble the scipy matrix, shape (3 free, 3 free), from blocks of shape (slots, 3, 3)."""
        row, column = self.row, self.column
        off = row != column
        rows = np.concatenate([row, column[off]])
        columns = np.concatenate([column, row[off]])
        blocks = np.concatenate([values, mirror[off].transpose(0, 2, 1)])
        order = np.lexsort((columns, rows))
        starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=self.free))])
        size = 3 * self.free
        return sparse.bsr_matrix((blocks[order], columns[order], starts), shape=(size, size)).tocsc()


@dataclass(frozen=True)
class Tangent:
    """Blocks of a tangent stiffness, laid out by a pattern.

    Args:
        values: Lower blocks [N/m], shape (slots, 3, 3).
        mirror: Transposes of the upper blocks; the same array when the tangent is symmetric.
    """

    values: Floats
    mirror: Floats

    @property
    def symmetric(self) -> bool:
        """Whether the upper blocks mirror the lower ones."""
        return self.mirror is self.values


def build_pattern(nodes: int, order: Indices, groups: Sequence[Indices]) -> Pattern:
    """Collect the pattern from the groups of coupled nodes.

    Args:
        nodes: Number of mesh nodes.
        order: Free nodes in elimination order.
        groups: Arrays of coupled nodes, each of shape (groups, nodes per group).
    """
    place = np.full(nodes, FIXED, dtype=np.int64)
    place[order] = np.arange(len(order))
    # The diagonal, with which every column begins.
    keys = [np.arange(len(order)) * (len(order) + 1)]
    for group in groups:
        first, second = np.broadcast_arrays(place[group][:, :, None], place[group][:, None, :])
        keep = (first >= second) & (second >= 0)
        keys.append(np.unique(second[keep] * len(order) + first[keep]))
    merged = np.unique(np.concatenate(keys))
    column, row = np.divmod(merged, len(order))
    starts = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=len(order)))])
    return Pattern(np.asarray(order, dtype=np.int64), place, starts, row)


def free_nodes(nodes: int, held: Indices, groups: Sequence[Indices]) -> Indices:
    """List the nodes that some group uses and nothing holds, ascending."""
    used = np.zeros(nodes, dtype=bool)
    for group in groups:
        used[group.ravel()] = True
    used[held] = False
    return np.flatnonzero(used)
