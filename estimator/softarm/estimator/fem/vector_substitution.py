"""Substitution of nodal vectors through a factor with one dof per node, their components side by side."""

import numpy as np

from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.lanes import LANES, fma, load, multiply, spread, store, zero
from softarm.estimator.mesh import Floats, Indices, Singles

ROW = 8 * LANES


@compiled
def _triangle(panel: Singles, height: int, first: int, last: int, x: int) -> None:
    """Solve with the lower triangle of a few columns."""
    for a in range(first, last):
        value = multiply(spread(1.0 / panel[a * height + a]), load(x + a * ROW))
        store(x + a * ROW, value)
        for i in range(a + 1, last):
            at = x + i * ROW
            store(at, fma(spread(-np.float64(panel[a * height + i])), value, load(at)))


@compiled
def _triangle_back(panel: Singles, height: int, first: int, last: int, x: int) -> None:
    """Solve with the transposed lower triangle of a few columns."""
    for a in range(last - 1, first - 1, -1):
        value = load(x + a * ROW)
        for i in range(a + 1, last):
            value = fma(spread(-np.float64(panel[a * height + i])), load(x + i * ROW), value)
        store(x + a * ROW, multiply(spread(1.0 / panel[a * height + a]), value))


@compiled
def _forward(panel: Singles, height: int, width: int, x: int) -> None:
    """Solve with the lower triangle of a front and subtract what follows from the rows below."""
    j = 0
    while j < width:
        last = min(j + 4, width)
        _triangle(panel, height, j, last, x)
        if last - j == 4:
            v0, v1 = load(x + j * ROW), load(x + (j + 1) * ROW)
            v2, v3 = load(x + (j + 2) * ROW), load(x + (j + 3) * ROW)
            c = j * height
            for i in range(last, height):
                value = fma(spread(-np.float64(panel[c + i])), v0, load(x + i * ROW))
                value = fma(spread(-np.float64(panel[c + height + i])), v1, value)
                value = fma(spread(-np.float64(panel[c + 2 * height + i])), v2, value)
                store(x + i * ROW, fma(spread(-np.float64(panel[c + 3 * height + i])), v3, value))
        else:
            for a in range(j, last):
                v0 = load(x + a * ROW)
                for i in range(last, height):
                    at = x + i * ROW
                    store(at, fma(spread(-np.float64(panel[a * height + i])), v0, load(at)))
        j = last


@compiled
def _backward(panel: Singles, height: int, width: int, x: int) -> None:
    """Solve with the transposed lower triangle of a front, the rows below being known."""
    last = width
    while last > 0:
        j = (last - 1) // 4 * 4
        c = j * height
        if last - j == 4:
            t0, t1, t2, t3 = zero(), zero(), zero(), zero()
            for i in range(last, height):
                value = load(x + i * ROW)
                t0 = fma(spread(-np.float64(panel[c + i])), value, t0)
                t1 = fma(spread(-np.float64(panel[c + height + i])), value, t1)
                t2 = fma(spread(-np.float64(panel[c + 2 * height + i])), value, t2)
                t3 = fma(spread(-np.float64(panel[c + 3 * height + i])), value, t3)
            one = spread(1.0)
            store(x + j * ROW, fma(one, t0, load(x + j * ROW)))
            store(x + (j + 1) * ROW, fma(one, t1, load(x + (j + 1) * ROW)))
            store(x + (j + 2) * ROW, fma(one, t2, load(x + (j + 2) * ROW)))
            store(x + (j + 3) * ROW, fma(one, t3, load(x + (j + 3) * ROW)))
        else:
            for a in range(j, last):
                t0 = load(x + a * ROW)
                for i in range(last, height):
                    t0 = fma(spread(-np.float64(panel[a * height + i])), load(x + i * ROW), t0)
                store(x + a * ROW, t0)
        _triangle_back(panel, height, j, last, x)
        last = j


@compiled
def substitute_vectors(
    pivots: Indices,
    borders: Indices,
    rows: Indices,
    row_start: Indices,
    panel_start: Indices,
    factor: Singles,
    right: Floats,
    free: Indices,
    solution: Floats,
) -> None:
    """Add the solution for nodal vectors ``right`` to ``solution``, both of shape (nodes, 3).

    ``free`` is the node of each dof; the other index arguments are those of ``Fronts`` of size 1.
    """
    work, local = np.zeros((free.shape[0], LANES)), np.zeros((free.shape[0], LANES))
    for n in range(free.shape[0]):
        for i in range(3):
            work[n, i] = right[free[n], i]
    fronts, x, all_rows = pivots.shape[0], local.ctypes.data, work.ctypes.data
    for turn in range(2 * fronts):
        ahead = turn < fronts
        s = turn if ahead else 2 * fronts - 1 - turn
        nodes = rows[row_start[s] : row_start[s + 1]]
        for n in range(nodes.shape[0]):
            store(x + n * ROW, load(all_rows + nodes[n] * ROW))
        panel = factor[panel_start[s] : panel_start[s + 1]]
        if ahead:
            _forward(panel, pivots[s] + borders[s], pivots[s], x)
        else:
            _backward(panel, pivots[s] + borders[s], pivots[s], x)
        for n in range(nodes.shape[0] if ahead else pivots[s]):
            store(all_rows + nodes[n] * ROW, load(x + n * ROW))
    for n in range(free.shape[0]):
        for i in range(3):
            solution[free[n], i] += work[n, i]
