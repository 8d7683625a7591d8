"""Substitution through a factor kept in single precision, for solves that something else corrects."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fem.compiled import reassociated
from estimator.fem.fronts import Fronts
from estimator.mesh import Floats, Indices

Singles = NDArray[np.float32]


@dataclass(frozen=True)
class CompactFactor:
    """A factor at half the memory, which is what a solve waits for; sums are still taken in double precision.

    Args:
        fronts: Dense fronts of the factor.
        panels: Its numbers.
    """

    fronts: Fronts
    panels: Singles

    def solve(self, right: Floats) -> Floats:
        """Solve with the symmetric part, shapes (size free,) or (right-hand sides, size free)."""
        f = self.fronts
        solution = np.array(np.atleast_2d(right), dtype=float, order="C")
        substitute_fronts(
            f.size, f.pivots, f.borders, f.rows, f.row_start, f.panel, self.panels, solution,
            np.empty((len(solution), f.widest)),
        )  # fmt: skip
        return solution.reshape(np.shape(right))


@reassociated
def _forward(panel: Singles, height: int, width: int, local: Floats) -> None:
    """Solve with the lower triangle of a front and subtract what follows from the rows below."""
    for j in range(width):
        column = panel[j * height + j : (j + 1) * height]
        for r in range(local.shape[0]):
            part = local[r, j:height]
            value = part[0] / column[0]
            for i in range(part.shape[0]):
                part[i] -= value * column[i]
            part[0] = value


@reassociated
def _backward(panel: Singles, height: int, width: int, local: Floats) -> None:
    """Solve with the transposed lower triangle of a front, the rows below being known."""
    for j in range(width - 1, -1, -1):
        column = panel[j * height + j : (j + 1) * height]
        for r in range(local.shape[0]):
            part = local[r, j:height]
            total = 0.0
            for i in range(1, part.shape[0]):
                total += part[i] * column[i]
            part[0] = (part[0] - total) / column[0]


@reassociated
def substitute_fronts(
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
    ``Fronts``.
    """
    fronts = pivots.shape[0]
    for turn in range(2 * fronts):
        ahead = turn < fronts
        s = turn if ahead else 2 * fronts - 1 - turn
        width, height = size * pivots[s], size * (pivots[s] + borders[s])
        nodes = rows[row_start[s] : row_start[s + 1]]
        for r in range(right.shape[0]):
            for n in range(nodes.shape[0]):
                for i in range(size):
                    local[r, size * n + i] = right[r, size * nodes[n] + i]
        panel = factor[panel_start[s] : panel_start[s + 1]]
        if ahead:
            _forward(panel, height, width, local)
        else:
            _backward(panel, height, width, local)
        for r in range(right.shape[0]):
            for n in range(nodes.shape[0] if ahead else pivots[s]):
                for i in range(size):
                    right[r, size * nodes[n] + i] = local[r, size * n + i]
