"""Kernels of the multifrontal Cholesky factorisation and of its solves."""

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.blas import Addresses, Letters, gemm, gemv, potrf, syrk, trsm, trsv

# Places of the options in `Blas.letters`.
NO, TRANSPOSED, RIGHT, LEFT = 1, 2, 3, 4


@compiled
def _assemble(
    panel: Floats, height: int, values: Floats, slots: Indices, rows: Indices, columns: Indices
) -> None:
    """Put blocks of the matrix into a front's panel, column-major of ``height`` dofs."""
    size = values.shape[1]
    for m in range(slots.shape[0]):
        for k in range(size):
            at = (size * columns[m] + k) * height + size * rows[m]
            for i in range(size):
                panel[at + i] = values[slots[m], i, k]


@compiled
def _extend(
    size: int,
    panel: Floats,
    height: int,
    pivots: int,
    update: Floats,
    border: int,
    child: Floats,
    relative: Indices,
) -> None:
    """Add a child's update matrix (lower triangle) to its parent's panel and update matrix."""
    count = relative.shape[0]
    for j in range(count):
        column = relative[j]
        for k in range(size):
            source = (size * j + k) * size * count
            if column < pivots:
                target = (size * column + k) * height
                # Only the lower triangle of an update matrix is computed and read.
                for i in range(j, count):
                    at, to = source + size * i, target + size * relative[i]
                    for d in range(size):
                        panel[to + d] += child[at + d]
            else:
                # `relative` counts rows from the parent's first pivot; its update matrix begins behind the
                # pivots.
                target = (size * (column - pivots) + k) * border - size * pivots
                for i in range(j, count):
                    at, to = source + size * i, target + size * relative[i]
                    for d in range(size):
                        update[to + d] += child[at + d]


@compiled
def factorise_multifrontal(
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
    ``SymbolicFactorisation``.
    """
    ints, reals = np.empty(8, dtype=np.int32), np.empty(2)
    size = values.shape[1]
    for s in range(pivots.shape[0]):
        width, border = size * pivots[s], size * borders[s]
        height = width + border
        panel = factor[panel_start[s] : panel_start[s + 1]]
        update = work[update_start[s] : update_start[s] + border * border]
        panel[:] = 0.0
        update[:] = 0.0
        part = slice(slot_start[s], slot_start[s + 1])
        _assemble(panel, height, values, slot[part], slot_row[part], slot_column[part])
        for c in children[child_start[s] : child_start[s + 1]]:
            child = work[update_start[c] : update_start[c] + size * size * borders[c] * borders[c]]
            places = relative[relative_start[c] : relative_start[c + 1]]
            _extend(size, panel, height, pivots[s], update, border, child, places)
        top = panel.ctypes.data
        below = top + 8 * width
        # LAPACK stops at the first pivot that is not positive: the arm is unstable there.
        if potrf(blas, letters, width, top, height, ints) != 0:
            return False
        if border > 0:
            trsm(blas, letters, RIGHT, TRANSPOSED, border, width, top, height, below, height, ints, reals)
            syrk(blas, letters, border, width, below, height, update.ctypes.data, border, ints, reals)
    return True


@compiled
def solve_multifrontal(  # noqa: C901 (one loop nest, compiled)
    blas: Addresses,
    letters: Letters,
    size: int,
    pivots: Indices,
    borders: Indices,
    rows: Indices,
    row_start: Indices,
    panel_start: Indices,
    factor: Floats,
    right: Floats,
    local: Floats,
) -> None:
    """Solve in place for right-hand sides in elimination order, shape (right-hand sides, size free).

    ``local`` is work space for the widest front in dofs times the right-hand sides; the index arguments are
    those of ``SymbolicFactorisation``.
    """
    ints = np.empty(8, dtype=np.int32)
    reals = np.empty(2)
    count = right.shape[0]
    front_count = pivots.shape[0]
    for sweep in range(2):
        for visit in range(front_count):
            # Forwards children come before their parent, backwards after it.
            s = visit if sweep == 0 else front_count - 1 - visit
            width, border = size * pivots[s], size * borders[s]
            height = width + border
            nodes = rows[row_start[s] : row_start[s + 1]]
            for r in range(count):
                for n in range(nodes.shape[0]):
                    for i in range(size):
                        local[r * height + size * n + i] = right[r, size * nodes[n] + i]
            panel = factor[panel_start[s] : panel_start[s + 1]].ctypes.data
            below = panel + 8 * width
            top = local.ctypes.data
            bottom = top + 8 * width
            if sweep == 0:
                # For one right-hand side the routines for vectors have the smaller overhead.
                if count == 1:
                    trsv(blas, letters, NO, width, panel, height, top, ints)
                    if border > 0:
                        gemv(blas, letters, NO, border, width, below, height, top, bottom, ints, reals)
                else:
                    trsm(blas, letters, LEFT, NO, width, count, panel, height, top, height, ints, reals)
                    if border > 0:
                        shape = (border, count, width)
                        gemm(
                            blas, letters, NO, NO, shape, below, height, top, height, bottom, height,
                            ints, reals,
                        )  # fmt: skip
            elif count == 1:
                if border > 0:
                    gemv(blas, letters, TRANSPOSED, border, width, below, height, bottom, top, ints, reals)
                trsv(blas, letters, TRANSPOSED, width, panel, height, top, ints)
            else:
                if border > 0:
                    shape = (width, count, border)
                    gemm(
                        blas, letters, TRANSPOSED, NO, shape, below, height, bottom, height, top, height,
                        ints, reals,
                    )  # fmt: skip
                trsm(blas, letters, LEFT, TRANSPOSED, width, count, panel, height, top, height, ints, reals)
            for r in range(count):
                # Backwards a front solves for its pivots alone; its border was solved further up the tree.
                for n in range(nodes.shape[0] if sweep == 0 else pivots[s]):
                    for i in range(size):
                        right[r, size * nodes[n] + i] = local[r * height + size * n + i]


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
