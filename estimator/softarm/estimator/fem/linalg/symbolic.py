"""Symbolic analysis of the multifrontal factorisation: done once per block pattern and block size."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Indices
from softarm.estimator.fem.linalg.ordering import Ordering
from softarm.estimator.fem.linalg.pattern import Pattern


@dataclass(frozen=True)
class SymbolicFactorisation:
    """Dense fronts, children before parents; all indices count blocks unless they are called dofs.

    Front s eliminates ``pivots[s]`` nodes and updates ``borders[s]`` others. Its panel holds the columns of
    the factor, (pivots + borders) by pivots; its update matrix is borders by borders; both are column-major
    in dofs.

    Args:
        size: Dofs per block, that is per node.
        pivots: Shape (fronts,).
        borders: Shape (fronts,).
        rows: Elimination positions of each front, pivots then border, concatenated.
        row_start: First entry of ``rows`` of each front, and the end, shape (fronts + 1,).
        children: Children of each front, concatenated.
        child_start: First entry of ``children`` of each front, and the end, shape (fronts + 1,).
        relative: Position in the parent front of each border node, concatenated over fronts.
        relative_start: First entry of ``relative`` of each front, and the end, shape (fronts + 1,).
        slot: Slots of the tangent assembled into each front, concatenated.
        slot_start: First entry of ``slot`` of each front, and the end, shape (fronts + 1,).
        slot_row: Block row of each in its front.
        slot_column: Block column of each in its front.
        panel: Offset in doubles of each front's panel, and the end, shape (fronts + 1,).
        update: Offset in doubles of each front's update matrix in the work space, shape (fronts,).
        work: Size in doubles of that work space.
    """

    size: int
    pivots: Indices
    borders: Indices
    rows: Indices
    row_start: Indices
    children: Indices
    child_start: Indices
    relative: Indices
    relative_start: Indices
    slot: Indices
    slot_start: Indices
    slot_row: Indices
    slot_column: Indices
    panel: Indices
    update: Indices
    work: int

    @property
    def widest(self) -> int:
        """Size of the largest front in dofs."""
        return self.size * int((self.pivots + self.borders).max(initial=0))


def analyse(pattern: Pattern, ordering: Ordering, size: int = 3) -> SymbolicFactorisation:
    """Find the fronts of a pattern whose free nodes stand in the ordering's order."""
    count = len(ordering.parent)
    owner = np.repeat(np.arange(count), np.diff(ordering.start))
    column = pattern.column
    slot_owner = owner[column]
    # Stable, so that the slots of a front stay in the order of its columns.
    by_owner = np.argsort(slot_owner, kind="stable")
    slot_start = np.searchsorted(slot_owner[by_owner], np.arange(count + 1))
    borders = _borders(pattern, ordering, by_owner, slot_start)
    children: list[list[int]] = [[] for _ in range(count)]
    for child, parent in enumerate(ordering.parent):
        if parent >= 0:
            children[parent].append(child)
    rows = [
        np.concatenate([np.arange(ordering.start[s], ordering.start[s + 1]), borders[s]])
        for s in range(count)
    ]
    relative = [
        np.searchsorted(rows[parent], borders[s]) if parent >= 0 else borders[s]
        for s, parent in enumerate(ordering.parent)
    ]
    slot_row, slot_column = np.empty_like(by_owner), np.empty_like(by_owner)
    for s in range(count):
        part = slice(slot_start[s], slot_start[s + 1])
        slot_row[part] = np.searchsorted(rows[s], pattern.row[by_owner[part]])
        slot_column[part] = column[by_owner[part]] - ordering.start[s]
    pivots = np.diff(ordering.start)
    sizes = np.array([len(border) for border in borders])
    update, work = _place(size**2 * sizes**2, ordering.parent)
    return SymbolicFactorisation(
        size=size,
        pivots=pivots,
        borders=sizes,
        rows=np.concatenate(rows),
        row_start=_starts([len(r) for r in rows]),
        children=np.array([child for group in children for child in group], dtype=np.int64),
        child_start=_starts([len(group) for group in children]),
        relative=np.concatenate(relative),
        relative_start=_starts(sizes),
        slot=by_owner,
        slot_start=slot_start,
        slot_row=slot_row,
        slot_column=slot_column,
        panel=_starts(size**2 * (pivots + sizes) * pivots),
        update=update,
        work=work,
    )


def _starts(sizes: Indices | list[int]) -> Indices:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def _borders(pattern: Pattern, ordering: Ordering, by_owner: Indices, slot_start: Indices) -> list[Indices]:
    """Collect the later nodes that each front touches, itself or through its children."""
    count = len(ordering.parent)
    pending: list[list[Indices]] = [[] for _ in range(count)]
    borders = []
    for s in range(count):
        rows = pattern.row[by_owner[slot_start[s] : slot_start[s + 1]]]
        touched = np.unique(np.concatenate([rows, *pending[s]]))
        border = touched[touched >= ordering.start[s + 1]]
        borders.append(border)
        if ordering.parent[s] >= 0:
            pending[ordering.parent[s]].append(border)
    return borders


def _place(sizes: Indices, parent: Indices) -> tuple[Indices, int]:
    """Assign each update matrix a place, free again once its parent has taken it in (first fit)."""
    places = np.zeros(len(sizes), dtype=np.int64)
    living: list[tuple[int, int, int]] = []
    total = 0
    for s, size in enumerate(sizes.tolist()):
        offset = 0
        for begin, end, _ in sorted(living):
            if offset + size <= begin:
                break
            offset = max(offset, end)
        places[s] = offset
        total = max(total, offset + size)
        # Only now: the children's matrices are still read while their parent's is filled.
        living = [entry for entry in living if parent[entry[2]] != s]
        living.append((offset, offset + size, s))
    return places, total
