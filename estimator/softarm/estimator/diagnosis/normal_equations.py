"""Everything a linear search needs of the recordings: products of residuals and columns, stretch by stretch.

With W the weights of a stretch's rows, r its residual and X its columns, the products X^T W X, X^T W r and
r^T W r answer any question about fits, predictions and their differences without touching samples again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats


@dataclass(frozen=True)
class NormalEquations:
    """The normal equations of one stretch.

    Args:
        session: Number of its session.
        block: Number of the stretch in the session.
        nominal: Whether the arm was in its known state.
        heldout: Whether no fit may see it.
        reported: Whether no choice may see it either.
        count: Number of residuals.
        matrix: X^T W X, shape (columns, columns).
        vector: X^T W r, shape (columns,).
        sum_of_squares: r^T W r.
    """

    session: int
    block: int
    nominal: bool
    heldout: bool
    reported: bool
    count: int
    matrix: Floats
    vector: Floats
    sum_of_squares: float

    def bordered(self, new: "NewColumns") -> "NormalEquations":
        """Put new columns behind these."""
        matrix = np.block([[self.matrix, new.cross], [new.cross.T, new.matrix]])
        return replace(self, matrix=matrix, vector=np.append(self.vector, new.vector))


@dataclass(frozen=True)
class NewColumns:
    """Products of new columns X, of shape (samples, new), in some stretches.

    Args:
        cross: C^T W X, with the columns C of the stretches' normal equations, shape (columns, new).
        matrix: X^T W X, shape (new, new).
        vector: X^T W r, shape (new,).
    """

    cross: Floats
    matrix: Floats
    vector: Floats

    def less(self, other: "NewColumns") -> "NewColumns":
        """Leave some of the stretches out."""
        return NewColumns(self.cross - other.cross, self.matrix - other.matrix, self.vector - other.vector)

    def first(self, count: int) -> "NewColumns":
        """Leave the last columns out."""
        return NewColumns(self.cross[:, :count], self.matrix[:count, :count], self.vector[:count])

    def beside_first(self, count: int) -> "NewColumns":
        """Count the first columns among those of the normal equations."""
        own = slice(count, None)
        cross = np.concatenate([self.cross[:, own], self.matrix[:count, own]])
        return NewColumns(cross, self.matrix[own, own], self.vector[own])


def normal_equations(
    residual: Floats,
    columns: Floats | NDArray[np.float32],
    scale: Floats,
    blocks: NDArray[np.int64],
    heldout: Flags,
    reported: Flags,
    session: int,
    *,
    nominal: bool,
) -> list[NormalEquations]:
    """Multiply a session's residuals and columns, stretch by stretch.

    Args:
        residual: NaN where lost, shape (samples, rows).
        columns: Shape (samples, rows, columns).
        scale: Standard deviation of each row, shape (rows,), or of each residual, (samples, rows).
        blocks: Stretch of each sample, shape (samples,).
        heldout: Samples held out, the same for a whole stretch, shape (samples,).
        reported: Those of them that decide nothing, likewise.
        session: Number of the session.
        nominal: Whether the arm was in its known state.
    """
    parts = []
    for block, samples, recorded, weight in _stretches(residual, scale, blocks):
        weighted = residual[samples][recorded] * weight
        rows: NDArray[Any] = np.asarray(columns[samples][recorded] * weight[:, None], dtype=columns.dtype)
        matrix = np.asarray(rows.T @ rows, dtype=np.float64)
        vector = np.asarray(rows.T @ weighted, dtype=np.float64)
        flags = bool(heldout[samples].any()), bool(reported[samples].any())
        sum_of_squares = float(weighted @ weighted)
        parts.append(
            NormalEquations(session, block, nominal, *flags, len(weighted), matrix, vector, sum_of_squares)
        )
    return parts


def renewed(
    parts: Sequence[NormalEquations],
    residual: Floats,
    columns: Floats | NDArray[np.float32],
    scale: Floats,
    blocks: NDArray[np.int64],
) -> list[NormalEquations]:
    """Compute those of a session with another residual, lost at the same places; see ``normal_equations``."""
    renewed_parts = []
    for part, samples, present, precision in _weighted(parts, residual, scale, blocks):
        vector = _pull(columns[samples], precision * present)
        renewed_parts.append(
            replace(part, vector=vector, sum_of_squares=float(present @ (precision * present)))
        )
    return renewed_parts


def with_columns(
    parts: Sequence[NormalEquations],
    residual: Floats,
    columns: Floats | NDArray[np.float32],
    more: Floats,
    scale: Floats,
    blocks: NDArray[np.int64],
) -> list[NewColumns]:
    """Multiply new columns, shape (samples, rows, new), in stretches of a session."""
    extended = []
    for _, samples, present, precision in _weighted(parts, residual, scale, blocks):
        new = np.nan_to_num(more[samples]).reshape(-1, more.shape[-1])
        weighted = precision[:, None] * new
        extended.append(NewColumns(_pull(columns[samples], weighted), new.T @ weighted, weighted.T @ present))
    return extended


def _weighted(
    parts: Sequence[NormalEquations], residual: Floats, scale: Floats, blocks: NDArray[np.int64]
) -> Iterator[tuple[NormalEquations, slice, Floats, Floats]]:
    """Yield stretches, their samples, residuals and inverse variances, both 0 where lost."""
    recorded = np.isfinite(residual)
    present, precision = np.where(recorded, residual, 0.0), np.where(recorded, 1.0 / scale**2, 0.0)
    for part in parts:
        samples = _samples(blocks, part.block)
        yield part, samples, present[samples].ravel(), precision[samples].ravel()


def _pull(columns: Floats | NDArray[np.float32], weighted: Floats) -> Floats:
    """Multiply columns, shape (samples, rows, columns), by what has as many rows, in their precision."""
    flat = columns.reshape(-1, columns.shape[-1])
    return np.asarray(np.dot(flat.T, weighted.astype(columns.dtype)), dtype=np.float64)


def _stretches(
    residual: Floats, scale: Floats, blocks: NDArray[np.int64]
) -> list[tuple[int, slice, Flags, Floats]]:
    """List the stretches that have residuals: number, samples, present residuals and their weights."""
    stretches = []
    spread = np.broadcast_to(scale, residual.shape)
    for block in np.unique(blocks):
        samples = _samples(blocks, block)
        recorded = np.isfinite(residual[samples])
        if recorded.any():
            stretches.append((int(block), samples, recorded, 1.0 / spread[samples][recorded]))
    return stretches


def _samples(blocks: NDArray[np.int64], block: int) -> slice:
    """Return the samples of a stretch, which follow each other: columns are not copied then."""
    first, end = np.searchsorted(blocks, [block, block + 1])
    return slice(int(first), int(end))


@dataclass(frozen=True)
class Total:
    """Sum of the normal equations of some stretches."""

    count: float
    matrix: Floats
    vector: Floats
    sum_of_squares: float

    def less(self, other: "Total") -> "Total":
        """Leave some of the stretches out."""
        return Total(
            self.count - other.count,
            self.matrix - other.matrix,
            self.vector - other.vector,
            self.sum_of_squares - other.sum_of_squares,
        )

    def selected(self, columns: Sequence[int]) -> "Total":
        """Return those of some columns, in their order."""
        chosen = list(columns)
        return replace(self, matrix=self.matrix[np.ix_(chosen, chosen)], vector=self.vector[chosen])


def total(parts: Sequence[NormalEquations], size: int) -> Total:
    """Add normal equations up."""
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    count, sum_of_squares = 0, 0.0
    for part in parts:
        matrix += part.matrix
        vector += part.vector
        count += part.count
        sum_of_squares += part.sum_of_squares
    return Total(count, matrix, vector, sum_of_squares)


def added(new: Sequence[NewColumns]) -> NewColumns:
    """Add products of new columns up."""
    return NewColumns(
        np.sum([one.cross for one in new], axis=0),
        np.sum([one.matrix for one in new], axis=0),
        np.sum([one.vector for one in new], axis=0),
    )
