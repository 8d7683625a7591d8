"""SIMD vectors inside compiled kernels, one lane per element: four doubles, or others by ``SimdType``.

LLVM does not vectorise short loops over arrays that might overlap; spelling the vectors out makes the element
kernels several times faster on any processor, without reordering a single sum.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices

SIMD_WIDTH = 4
"""Doubles in a vector."""
BYTES = 8
"""Alignment that NumPy guarantees."""


class SimdType(types.Type):
    """Type of a vector of numbers.

    Args:
        name: Name of the type.
        element: LLVM's type of a number.
        count: Numbers in it.
    """

    def __init__(self, name: str, element: Any, count: int) -> None:
        super().__init__(name=name)
        self.element = element
        self.count = count

    @property
    def vector(self) -> Any:
        """LLVM's type of the vector."""
        return ir.VectorType(self.element, self.count)


@register_model(SimdType)
class _SimdModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.vector)  # type: ignore[no-untyped-call,unused-ignore]


doubles = SimdType("SimdDoubles", ir.DoubleType(), SIMD_WIDTH)


def simd_groups(count: int, lanes: int) -> tuple[Indices, NDArray[np.bool_]]:
    """Deal elements out to groups of lanes; return the element of each lane, and which lanes are padding."""
    # The last group is filled up with copies of the last element, which compute and add nothing.
    lane = np.arange(-(-count // lanes) * lanes)
    return np.minimum(lane, count - 1), lane >= count


def simd_axis_last(values: Floats, lanes: int) -> Floats:
    """Move the lanes last, shape (groups lanes, ...) to (groups, ..., lanes)."""
    lanes_second = values.reshape(-1, lanes, *values.shape[1:])
    return np.ascontiguousarray(np.moveaxis(lanes_second, 1, -1))


def load_of(lanes: SimdType) -> Any:
    """Make the function that reads a vector at an address."""

    def read(context: Any, address: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            # Without an alignment of its own LLVM assumes that of the whole vector, and the program crashes.
            return builder.load(builder.inttoptr(values[0], lanes.vector.as_pointer()), align=BYTES)

        return lanes(types.int64), generate

    return intrinsic(read)


def store_of(lanes: SimdType) -> Any:
    """Make the function that writes a vector at an address."""

    def write(context: Any, address: Any, vector: Any) -> Any:  # noqa: ARG001
        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            pointer = builder.inttoptr(values[0], lanes.vector.as_pointer())
            builder.store(values[1], pointer, align=BYTES)
            return context.get_dummy_value()

        return types.void(types.int64, lanes), generate

    return intrinsic(write)


def fma_of(lanes: SimdType) -> Any:
    """Make the function of first * second + added."""

    def add_product(context: Any, first: Any, second: Any, added: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            kind = ir.FunctionType(lanes.vector, [lanes.vector] * 3)
            name = f"llvm.fmuladd.v{lanes.count}f{64 if lanes.element == ir.DoubleType() else 32}"
            function = cgutils.get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call]
            return builder.call(function, values)

        return lanes(lanes, lanes, lanes), generate

    return intrinsic(add_product)


def binary_of(lanes: SimdType, operation: str) -> Any:
    """Make the function of two vectors by an operation of LLVM."""

    def combine(context: Any, first: Any, second: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            return getattr(builder, operation)(*values)

        return lanes(lanes, lanes), generate

    return intrinsic(combine)


def constant_of(lanes: SimdType, number: float) -> Any:
    """Make the function that returns one number in every lane."""

    def give(context: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, __: Any, ___: Any, ____: Any) -> Any:
            return ir.Constant(lanes.vector, [number] * lanes.count)

        return lanes(), generate

    return intrinsic(give)


def broadcast_of(lanes: SimdType) -> Any:
    """Make the function that repeats a number in every lane."""

    def repeat(context: Any, number: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            nothing = ir.Constant(lanes.vector, ir.Undefined)
            first = builder.insert_element(nothing, values[0], ir.Constant(ir.IntType(32), 0))
            mask = ir.Constant(ir.VectorType(ir.IntType(32), lanes.count), [0] * lanes.count)
            return builder.shuffle_vector(first, nothing, mask)

        return lanes(types.float64 if lanes.element == ir.DoubleType() else types.float32), generate

    return intrinsic(repeat)


# mypy sees the functions as kernels do: vectors are opaque.
load = cast("Callable[[int], Any]", load_of(doubles))
"""Read four doubles at an address."""
store = cast("Callable[[int, Any], None]", store_of(doubles))
"""Write four doubles at an address."""
fma = cast("Callable[[Any, Any, Any], Any]", fma_of(doubles))
"""Return first * second + added, rounded once where the processor can."""
multiply = cast("Callable[[Any, Any], Any]", binary_of(doubles, "fmul"))
"""Return first * second."""
zero = cast("Callable[[], Any]", constant_of(doubles, 0.0))
"""Return four zeros."""
