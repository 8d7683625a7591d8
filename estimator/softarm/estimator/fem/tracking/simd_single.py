"""SIMD vectors of eight single-precision numbers, for the kernels of tracking."""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir  # type: ignore[import-untyped]

from softarm.estimator.fem.linalg.simd import (
    SimdType,
    binary_of,
    broadcast_of,
    constant_of,
    fma_of,
    load_of,
    store_of,
)

SINGLE_LANES = 8
"""Numbers in a vector."""

singles = SimdType("SimdSingles", ir.FloatType(), SINGLE_LANES)

load_singles = cast("Callable[[int], Any]", load_of(singles))
"""Read eight numbers at an address."""
store_singles = cast("Callable[[int, Any], None]", store_of(singles))
"""Write eight numbers at an address."""
fma_singles = cast("Callable[[Any, Any, Any], Any]", fma_of(singles))
"""Return first * second + added, rounded once where the processor can."""
multiply_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fmul"))
"""Return first * second."""
add_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fadd"))
"""Return first + second."""
subtract_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fsub"))
"""Return first - second."""
divide_singles = cast("Callable[[Any, Any], Any]", binary_of(singles, "fdiv"))
"""Return first / second."""
zero_singles = cast("Callable[[], Any]", constant_of(singles, 0.0))
"""Return eight zeros."""
broadcast_single = cast("Callable[[Any], Any]", broadcast_of(singles))
"""Return a number in every lane; it must be of single precision."""
