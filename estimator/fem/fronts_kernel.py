"""Kernels of the multifrontal Cholesky factorisation and of its solves."""

import numpy as np

from estimator.fem.blas import Addresses, Letters, gemm, gemv, potrf, syrk, trsm, trsv
from estimator.fem.compiled import compiled
from estimator.mesh import Floats, Indices

NO, TRANSPOSED, RIGHT, LEFT = 1, 2, 3, 4


@compiled
def _assemble(
    panel: Floats, height: int, values: Floats, slots: Indices, rows: Indices, columns: Indices
) -> None:
    """Put blocks of the tangent into a front's panel, column-major of ``height`` dofs."""
    for m in range(slots.shape[0]):
        for k in range(3):
            at = (3 * columns[m] + k) * height + 3 * rows[m]
            for i in range(3):
                panel[at + i] = values[slots[m], i, k]


@compiled
def _extend(
    panel: Floats, height: int, pivots: int, update: Floats, border: int, child: Floats, relative: Indices
) -> None:
    """Add a child's update matrix (lower triangle) to its parent's panel and update matrix."""
    count = relative.shape[0]
    for j in range(count):
        column = relative[j]
        for k in range(3):
            source = (3 * j + k) * 3 * count
            if column < pivots:
                target = (3 * column + k) * height
                for i in range(j, count):
                    at, to = source + 3 * i, target + 3 * relative[i]
                    panel[to] += child[at]
                    panel[to + 1] += child[at + 1]
                    panel[to + 2] += child[at + 2]
            else:
                target = (3 * (column - pivots) + k) * border - 3 * pivots
                for i in range(j, count):
                    at, to = source + 3 * i, target + 3 * relative[i]
                    update[to] += child[at]
                    update[to + 1] += child[at + 1]
                    update[to + 2] += child[at + 2]


@compiled
def factor_fronts(
    blas: Addresses,
    letters: Letters,
    values: Floats,
    pivots: Indices,
    borders: Indices,
    children: Indices,
    child_start: Indices,
    relative: Indices,
    relative_start: Indices,
    slot: Indices,
    slot_start: Indices,
    slot_row: Indices,
    slot_column: Indices,
    panel_start: Indices,
    update_start: Indices,
    factor: Floats,
    work: Floats,
) -> bool:
    """Factor all fronts; return whether the matrix is positive definite.

    ``factor`` (the panels) and ``work`` (the update matrices) are filled; the index arguments are those of
    ``Fronts``.
    """
    ints, reals = np.empty(8, dtype=np.int32), np.empty(2)
    for s in range(pivots.shape[0]):
        width, border = 3 * pivots[s], 3 * borders[s]
        height = width + border
        panel = factor[panel_start[s] : panel_start[s + 1]]
        update = work[update_start[s] : update_start[s] + border * border]
        panel[:] = 0.0
        update[:] = 0.0
        part = slice(slot_start[s], slot_start[s + 1])
        _assemble(panel, height, values, slot[part], slot_row[part], slot_column[part])
        for c in children[child_start[s] : child_start[s + 1]]:
            child = work[update_start[c] : update_start[c] + 9 * borders[c] * borders[c]]
            places = relative[relative_start[c] : relative_start[c + 1]]
            _extend(panel, height, pivots[s], update, border, child, places)
        top = panel.ctypes.data
        below = top + 8 * width
        if potrf(blas, letters, width, top, height, ints) != 0:
            return False
        if border > 0:
            trsm(blas, letters, RIGHT, TRANSPOSED, border, width, top, height, below, height, ints, reals)
            syrk(blas, letters, border, width, below, height, update.ctypes.data, border, ints, reals)
    return True


@compiled
def solve_fronts(  # noqa: C901 (one loop nest, compiled)
    blas: Addresses,
    letters: Letters,
    pivots: Indices,
    borders: Indices,
    rows: Indices,
    row_start: Indices,
    panel_start: Indices,
    factor: Floats,
    right: Floats,
    local: Floats,
) -> None:
    """Solve in place for right-hand sides in elimination order, shape (right-hand sides, 3 free).

    ``local`` is work space for the widest front in dofs times the right-hand sides; the index arguments are
    those of ``Fronts``.
    """
    ints = np.empty(8, dtype=np.int32)
    reals = np.empty(2)
    count = right.shape[0]
    fronts = pivots.shape[0]
    for sweep in range(2):
        for turn in range(fronts):
            s = turn if sweep == 0 else fronts - 1 - turn
            width, border = 3 * pivots[s], 3 * borders[s]
            height = width + border
            nodes = rows[row_start[s] : row_start[s + 1]]
            for r in range(count):
                for n in range(nodes.shape[0]):
                    for i in range(3):
                        local[r * height + 3 * n + i] = right[r, 3 * nodes[n] + i]
            panel = factor[panel_start[s] : panel_start[s + 1]].ctypes.data
            below = panel + 8 * width
            top = local.ctypes.data
            bottom = top + 8 * width
            if sweep == 0:
                if count == 1:
                    trsv(blas, letters, NO, width, panel, height, top, ints)
                    if border > 0:
                        gemv(blas, letters, NO, border, width, below, height, top, bottom, ints, reals)
                else:
                    trsm(blas, letters, LEFT, NO, width, count, panel, height, top, height, ints, reals)
                    if border > 0:
                        shape = (border, count, width)
                        gemm(
                            blas,
                            letters,
                            NO,
                            NO,
                            shape,
                            below,
                            height,
                            top,
                            height,
                            bottom,
                            height,
                            ints,
                            reals,
                        )
            elif count == 1:
                if border > 0:
                    gemv(blas, letters, TRANSPOSED, border, width, below, height, bottom, top, ints, reals)
                trsv(blas, letters, TRANSPOSED, width, panel, height, top, ints)
            else:
                if border > 0:
                    shape = (width, count, border)
                    gemm(
                        blas,
                        letters,
                        TRANSPOSED,
                        NO,
                        shape,
                        below,
                        height,
                        bottom,
                        height,
                        top,
                        height,
                        ints,
                        reals,
                    )
                trsm(blas, letters, LEFT, TRANSPOSED, width, count, panel, height, top, height, ints, reals)
            for r in range(count):
                for n in range(nodes.shape[0] if sweep == 0 else pivots[s]):
                    for i in range(3):
                        right[r, 3 * nodes[n] + i] = local[r * height + 3 * n + i]


@compiled
def multiply_blocks(
    values: Floats,
    mirror: Floats,
    row: Indices,
    column_start: Indices,
    vectors: Floats,
    product: Floats,
    flip: bool,
) -> None:
    """Fill K x, or K^T x when ``flip``, for each row of ``vectors``, shape (vectors, 3 free)."""
    product[:] = 0.0
    for j in range(column_start.shape[0] - 1):
        for slot in range(column_start[j], column_start[j + 1]):
            i = row[slot]
            for a in range(3):
                for b in range(3):
                    low = mirror[slot, a, b] if flip else values[slot, a, b]
                    high = values[slot, a, b] if flip else mirror[slot, a, b]
                    for r in range(vectors.shape[0]):
                        product[r, 3 * i + a] += low * vectors[r, 3 * j + b]
                        if i != j:
                            product[r, 3 * j + b] += high * vectors[r, 3 * i + a]
