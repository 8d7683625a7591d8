"""Substitution through a factor kept in single precision, for solves that something else corrects.

Four columns of a front go together, so that the right-hand side passes through the processor once for them.
"""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled, reassociated
from softarm.estimator.fem.linalg.cholesky import CholeskyFactor
from softarm.estimator.fem.linalg.symbolic import SymbolicFactorisation
from softarm.estimator.mesh import Singles


@dataclass(frozen=True)
class SingleFactor:
    """A factor at half the memory, which is what a solve waits for; sums still have double precision."""

    symbolic: SymbolicFactorisation
    panels: Singles

    @classmethod
    def of(cls, factor: CholeskyFactor) -> "SingleFactor":
        """Copy a factor to single precision."""
        return cls(factor.plan.symbolic, factor.panels.astype(np.float32))

    def solve(self, right: Floats) -> Floats:
        """Solve with the symmetric part, shapes (size free,) or (right-hand sides, size free)."""
        s = self.symbolic
        solution = np.array(np.atleast_2d(right), dtype=float, order="C")
        solve_multifrontal_single(
            s.size, s.pivots, s.borders, s.rows, s.row_start, s.panel, self.panels, solution,
            np.empty((len(solution), s.widest)),
        )  # fmt: skip
        return solution.reshape(np.shape(right))


@reassociated
def _forward(panel: Singles, height: int, width: int, x: Floats) -> None:
    """Solve with the lower triangle of a front and subtract what follows from the rows below."""
    j = 0
    while j < width:
        wide = min(4, width - j)
        for a in range(j, j + wide):
            value = x[a] / panel[a * height + a]
            x[a] = value
            for i in range(a + 1, j + wide):
                x[i] -= value * panel[a * height + i]
        first = j + wide
        if wide == 4:
            c0 = panel[j * height + first : (j + 1) * height]
            c1 = panel[(j + 1) * height + first : (j + 2) * height]
            c2 = panel[(j + 2) * height + first : (j + 3) * height]
            c3 = panel[(j + 3) * height + first : (j + 4) * height]
            v0, v1, v2, v3 = x[j], x[j + 1], x[j + 2], x[j + 3]
            rest = x[first:height]
            for i in range(rest.shape[0]):
                rest[i] -= v0 * c0[i] + v1 * c1[i] + v2 * c2[i] + v3 * c3[i]
        else:
            for a in range(j, first):
                column = panel[a * height + first : (a + 1) * height]
                value, rest = x[a], x[first:height]
                for i in range(rest.shape[0]):
                    rest[i] -= value * column[i]
        j = first


@reassociated
def _backward(panel: Singles, height: int, width: int, x: Floats) -> None:
    """Solve with the transposed lower triangle of a front, the rows below being solved."""
    last = width
    while last > 0:
        # Blocks of four are counted from the first column, as forwards, so that an odd one comes first here.
        j = (last - 1) // 4 * 4
        rest = x[last:height]
        if last - j == 4:
            c0 = panel[j * height + last : (j + 1) * height]
            c1 = panel[(j + 1) * height + last : (j + 2) * height]
            c2 = panel[(j + 2) * height + last : (j + 3) * height]
            c3 = panel[(j + 3) * height + last : (j + 4) * height]
            t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
            for i in range(rest.shape[0]):
                value = rest[i]
                t0 += value * c0[i]
                t1 += value * c1[i]
                t2 += value * c2[i]
                t3 += value * c3[i]
            x[j] -= t0
            x[j + 1] -= t1
            x[j + 2] -= t2
            x[j + 3] -= t3
        else:
            for a in range(j, last):
                column = panel[a * height + last : (a + 1) * height]
                total = 0.0
                for i in range(rest.shape[0]):
                    total += rest[i] * column[i]
                x[a] -= total
        for a in range(last - 1, j - 1, -1):
            for i in range(a + 1, last):
                x[a] -= x[i] * panel[a * height + i]
            x[a] /= panel[a * height + a]
        last = j


@compiled
def solve_multifrontal_single(
    size: int,
    pivots: Indices,
    borders: Indices,
    rows: Indices,
    row_start: Indices,
    panel_start: Indices,
    factor: Singles,
    right: Floats,
    local: Floats,
) -> None:
    """Solve in place for right-hand sides in elimination order, shape (right-hand sides, size free).

    ``local`` is work space, shape (right-hand sides, widest front in dofs); the index arguments are those of
    ``SymbolicFactorisation``.
    """
    front_count = pivots.shape[0]
    for visit in range(2 * front_count):
        ahead = visit < front_count
        s = visit if ahead else 2 * front_count - 1 - visit
        width, height = size * pivots[s], size * (pivots[s] + borders[s])
        nodes = rows[row_start[s] : row_start[s + 1]]
        panel = factor[panel_start[s] : panel_start[s + 1]]
        for r in range(right.shape[0]):
            for n in range(nodes.shape[0]):
                for i in range(size):
                    local[r, size * n + i] = right[r, size * nodes[n] + i]
            if ahead:
                _forward(panel, height, width, local[r])
            else:
                _backward(panel, height, width, local[r])
            for n in range(nodes.shape[0] if ahead else pivots[s]):
                for i in range(size):
                    right[r, size * nodes[n] + i] = local[r, size * n + i]
