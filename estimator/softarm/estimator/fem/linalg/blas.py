"""BLAS and LAPACK of scipy, callable from compiled kernels.

A routine's address is an argument at run time, so that the compiled code holds no pointer and can be kept
on disk.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import types
from numba.extending import get_cython_function_address, intrinsic
from numpy.typing import NDArray

from softarm.estimator.fem.compiled import compiled

Addresses = NDArray[np.int64]
Letters = NDArray[np.uint8]


@dataclass(frozen=True)
class Blas:
    """What a kernel needs to call BLAS.

    Args:
        addresses: Addresses of dpotrf, dtrsm, dsyrk, dgemm, dtrsv, dgemv, dgetrf, dgetrs.
        letters: The option letters ``L``, ``N``, ``T``, ``R``, ``L``.
    """

    addresses: Addresses
    letters: Letters


@cache
def load_blas() -> Blas:
    """Look up the routines in scipy."""
    names = ["dpotrf", "dtrsm", "dsyrk", "dgemm", "dtrsv", "dgemv", "dgetrf", "dgetrs"]
    modules = ["lapack", *["blas"] * 5, *["lapack"] * 2]
    addresses = [
        get_cython_function_address(f"scipy.linalg.cython_{module}", name)
        for module, name in zip(modules, names, strict=True)
    ]
    # Fortran takes options by address, too: L as in lower, N, T, R, and L as in left.
    return Blas(np.array(addresses, dtype=np.int64), np.frombuffer(b"LNTRL", dtype=np.uint8).copy())


def _call_address(context: Any, address: Any, arguments: Any) -> Any:  # noqa: ARG001
    """Call a C function at an address with pointers, given as integers, for arguments."""
    signature = types.void(types.int64, arguments)

    def generate(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        count = len(signature.args[1])
        numbers = [builder.extract_value(values[1], k) for k in range(count)]
        kind = ir.FunctionType(ir.VoidType(), [pointer] * count)
        function = builder.inttoptr(values[0], kind.as_pointer())
        builder.call(function, [builder.inttoptr(number, pointer) for number in numbers])
        # What numba passes for None.
        return ir.Constant(ir.IntType(8).as_pointer(), None)

    return signature, generate


call_address = cast("Callable[[int, tuple[int, ...]], None]", intrinsic(_call_address))


@compiled
def potrf(blas: Addresses, letters: Letters, n: int, a: int, lda: int, ints: NDArray[np.int32]) -> int:
    """Factor the lower triangle of a column-major matrix at address ``a``; return LAPACK's info."""
    ints[0], ints[1], ints[2] = n, lda, 0
    # Fortran's integers have four bytes; one behind the other they are the arguments' addresses.
    i = ints.ctypes.data
    call_address(blas[0], (letters.ctypes.data, i, a, i + 4, i + 8))
    return int(ints[2])


@compiled
def trsm(
    blas: Addresses,
    letters: Letters,
    side: int,
    transposed: int,
    m: int,
    n: int,
    a: int,
    lda: int,
    b: int,
    ldb: int,
    ints: NDArray[np.int32],
    reals: NDArray[np.float64],
) -> None:
    """Solve with a lower triangle: op(A) X = B (side 4) or X op(A) = B (side 3), B overwritten, m x n."""
    ints[0], ints[1], ints[2], ints[3] = m, n, lda, ldb
    reals[0] = 1.0
    i, t = ints.ctypes.data, letters.ctypes.data
    call_address(
        blas[1], (t + side, t, t + transposed, t + 1, i, i + 4, reals.ctypes.data, a, i + 8, b, i + 12)
    )


@compiled
def syrk(
    blas: Addresses,
    letters: Letters,
    n: int,
    k: int,
    a: int,
    lda: int,
    c: int,
    ldc: int,
    ints: NDArray[np.int32],
    reals: NDArray[np.float64],
) -> None:
    """Subtract A A^T from the lower triangle of C, A of n x k."""
    ints[0], ints[1], ints[2], ints[3] = n, k, lda, ldc
    reals[0], reals[1] = -1.0, 1.0
    i, t, r = ints.ctypes.data, letters.ctypes.data, reals.ctypes.data
    call_address(blas[2], (t, t + 1, i, i + 4, r, a, i + 8, r + 8, c, i + 12))


@compiled
def gemm(
    blas: Addresses,
    letters: Letters,
    left: int,
    right: int,
    shape: tuple[int, int, int],
    a: int,
    lda: int,
    b: int,
    ldb: int,
    c: int,
    ldc: int,
    ints: NDArray[np.int32],
    reals: NDArray[np.float64],
) -> None:
    """Subtract op(A) op(B) from C, ``shape`` m, n, k; ``left``, ``right`` are 1 (as is) or 2 (transposed)."""
    ints[0], ints[1], ints[2] = shape
    ints[3], ints[4], ints[5] = lda, ldb, ldc
    reals[0], reals[1] = -1.0, 1.0
    i, t, r = ints.ctypes.data, letters.ctypes.data, reals.ctypes.data
    call_address(blas[3], (t + left, t + right, i, i + 4, i + 8, r, a, i + 12, b, i + 16, r + 8, c, i + 20))


@compiled
def trsv(
    blas: Addresses,
    letters: Letters,
    transposed: int,
    n: int,
    a: int,
    lda: int,
    x: int,
    ints: NDArray[np.int32],
) -> None:
    """Solve op(A) x = b with a lower triangle, x overwritten."""
    ints[0], ints[1], ints[2] = n, lda, 1
    i, t = ints.ctypes.data, letters.ctypes.data
    call_address(blas[4], (t, t + transposed, t + 1, i, a, i + 4, x, i + 8))


@compiled
def gemv(
    blas: Addresses,
    letters: Letters,
    transposed: int,
    m: int,
    n: int,
    a: int,
    lda: int,
    x: int,
    y: int,
    ints: NDArray[np.int32],
    reals: NDArray[np.float64],
) -> None:
    """Subtract op(A) x from y, A of m x n."""
    ints[0], ints[1], ints[2], ints[3] = m, n, lda, 1
    reals[0], reals[1] = -1.0, 1.0
    i, t, r = ints.ctypes.data, letters.ctypes.data, reals.ctypes.data
    call_address(blas[5], (t + transposed, i, i + 4, r, a, i + 8, x, i + 12, r + 8, y, i + 12))


@compiled
def solve_rows(
    blas: Addresses,
    letters: Letters,
    matrix: NDArray[np.float64],
    right: NDArray[np.float64],
    ints: NDArray[np.int32],
) -> None:
    """Solve A x = b by LU factors; compiling ``numpy.linalg.solve`` would take ten seconds.

    Args:
        blas: Addresses.
        letters: Option letters.
        matrix: A, overwritten, shape (n, n).
        right: One b per row, overwritten by the x, shape (columns, n). Not finite where A is singular.
        ints: Memory, shape (3 + n,).
    """
    # n, the number of right-hand sides, LAPACK's info, then the pivots.
    ints[0], ints[1] = matrix.shape[0], right.shape[0]
    i, a, b = ints.ctypes.data, matrix.ctypes.data, right.ctypes.data
    call_address(blas[6], (i, i, a, i, i + 12, i + 8))
    # Row by row is the transposed matrix to LAPACK.
    call_address(blas[7], (letters.ctypes.data + 2, i, i + 4, a, i, i + 12, b, i, i + 8))
