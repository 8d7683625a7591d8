"""Intel's PARDISO as the backend of the factor, where ``pypardiso`` is installed.

Its wheel finds MKL; the routine is called directly, for the symmetric positive definite case and with the
symbolic analysis kept, which pypardiso's own interface does not offer.
"""

import ctypes
from collections import deque
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.linalg.pattern import Pattern

# PARDISO's codes: the type of the matrix, the phases, and the error of a pivot that is not positive.
POSITIVE_DEFINITE = 2
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1
NOT_DEFINITE = -4

Ints = NDArray[np.int32]


@cache
def load_pardiso() -> Any | None:
    """Load MKL's routine; None where pypardiso is not installed or finds no MKL."""
    try:
        from pypardiso.pardiso_wrapper import PyPardisoSolver
    except ImportError:
        return None
    try:
        library = PyPardisoSolver(mtype=POSITIVE_DEFINITE).libmkl
    except (ImportError, OSError):
        return None
    # One thread, like the rest of an estimate: spinning threads ruin the latency on a shared core.
    library.MKL_Set_Num_Threads(ctypes.c_int(1))
    return library.pardiso


@dataclass(frozen=True)
class CompressedRows:
    """The upper triangle of a pattern in compressed rows, indices from 1.

    Args:
        start: First entry of each row, and the end, shape (size + 1,).
        column: Column of each entry.
        entry: Where each stands in the flattened blocks.
    """

    start: Ints
    column: Ints
    entry: Indices

    @classmethod
    def of(cls, pattern: Pattern) -> "CompressedRows":
        """List the entries of a pattern of 3 x 3 blocks."""
        slot = np.arange(pattern.slots)
        i, j = np.meshgrid(np.arange(3), np.arange(3), indexing="ij")
        # A block column of the lower triangle is a block row of the upper one.
        row = (3 * pattern.column[:, None, None] + j).ravel()
        column = (3 * pattern.row[:, None, None] + i).ravel()
        entry = (9 * slot[:, None, None] + 3 * i + j).ravel()
        keep = column >= row
        row, column, entry = row[keep], column[keep], entry[keep]
        order = np.lexsort((column, row))
        starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=3 * pattern.free))])
        return cls((starts + 1).astype(np.int32), (column[order] + 1).astype(np.int32), entry[order])


class Handle:
    """PARDISO's memory of one pattern and one factor."""

    def __init__(self, routine: Any, rows: CompressedRows) -> None:
        self._routine, self._rows = routine, rows
        self._memory = np.zeros(64, dtype=np.int64)
        self._options = np.zeros(64, dtype=np.int32)
        # No defaults; METIS ordering; two steps of refinement at most, only after perturbed pivots.
        self._options[[0, 1, 9]] = 1, 2, 8
        nothing = np.zeros(1)
        self._check(self.call(ANALYSE, nothing[:0], nothing, nothing, 1))

    def call(self, phase: int, values: Floats, right: Floats, solution: Floats, columns: int) -> int:
        """Run a phase; return PARDISO's error number."""
        error = ctypes.c_int32(0)
        number, ints = ctypes.c_int32, ctypes.POINTER(ctypes.c_int32)
        one, kind, zero = number(1), number(POSITIVE_DEFINITE), number(0)
        rows, doubles = self._rows, ctypes.POINTER(ctypes.c_double)
        self._routine(
            self._memory.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)), ctypes.byref(one),
            ctypes.byref(one), ctypes.byref(kind), ctypes.byref(number(phase)),
            ctypes.byref(number(len(rows.start) - 1)), values.ctypes.data_as(doubles),
            rows.start.ctypes.data_as(ints), rows.column.ctypes.data_as(ints), ints(),
            ctypes.byref(number(columns)), self._options.ctypes.data_as(ints), ctypes.byref(zero),
            right.ctypes.data_as(doubles), solution.ctypes.data_as(doubles), ctypes.byref(error),
        )  # fmt: skip
        return error.value

    @staticmethod
    def _check(error: int) -> None:
        if error:
            raise RuntimeError(f"PARDISO ended with error {error}")

    def factorise(self, values: Floats) -> bool:
        """Factor the matrix with the given entries; return whether it is positive definite."""
        nothing = np.zeros(1)
        error = self.call(FACTORISE, values, nothing, nothing, 1)
        if error != NOT_DEFINITE:
            self._check(error)
        return error == 0

    def solve(self, values: Floats, right: Floats) -> Floats:
        """Solve for right-hand sides, shape (right-hand sides, size)."""
        solution = np.empty_like(right)
        self._check(self.call(SOLVE, values, right, solution, len(right)))
        return solution

    def __del__(self) -> None:
        nothing = np.zeros(1)
        self.call(RELEASE, nothing, nothing, nothing, 1)


@dataclass(frozen=True)
class PardisoPlan:
    """Factors the tangents of a pattern by PARDISO.

    Args:
        routine: MKL's routine.
        rows: The pattern.
        idle: Handles whose factor nobody uses any more; they keep the symbolic analysis.
    """

    routine: Any
    rows: CompressedRows
    idle: deque[Handle] = field(default_factory=deque)

    @classmethod
    def of(cls, pattern: Pattern) -> "PardisoPlan | None":
        """Prepare a pattern of 3 x 3 blocks; None where PARDISO is not installed."""
        routine = load_pardiso()
        return None if routine is None else cls(routine, CompressedRows.of(pattern))

    def factorise(self, values: Floats) -> "PardisoFactor | None":
        """Factor a matrix of blocks, shape (slots, 3, 3); None where it is not positive definite."""
        try:
            # Pop and append of a deque are atomic: a factor may be collected in any thread.
            handle = self.idle.pop()
        except IndexError:
            handle = Handle(self.routine, self.rows)
        entries = values.reshape(-1)[self.rows.entry]
        if not handle.factorise(entries):
            self.idle.append(handle)
            return None
        return PardisoFactor(handle, entries, self.idle)


class PardisoFactor:
    """A factor in PARDISO's memory.

    Args:
        handle: The memory.
        entries: Entries of the matrix, which PARDISO refines against.
        idle: Where the handle goes when the factor is no longer used.
    """

    def __init__(self, handle: Handle, entries: Floats, idle: deque[Handle]) -> None:
        self._handle, self._entries, self._idle = handle, entries, idle

    def solve(self, right: Floats) -> Floats:
        """Solve for right-hand sides in elimination order, shapes (size,) or (right-hand sides, size)."""
        stacked = np.array(np.atleast_2d(right), dtype=float, order="C")
        return self._handle.solve(self._entries, stacked).reshape(np.shape(right))

    def __del__(self) -> None:
        # Kept, not released: the next factor of this pattern finds its symbolic analysis done.
        self._idle.append(self._handle)
