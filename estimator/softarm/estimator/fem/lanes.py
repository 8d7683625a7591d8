"""Vectors inside compiled kernels, one lane per element: four doubles or eight single-precision numbers.

LLVM does not vectorise short loops over arrays that might overlap; spelling the vectors out makes the element
kernels several times faster on any processor, without reordering a single sum.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

LANES = 4
"""Doubles in a vector."""
SINGLE_LANES = 8
"""Single-precision numbers in a vector."""
BYTES = 8
"""Alignment that NumPy guarantees."""


class Lanes(types.Type):
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


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.vector)  # type: ignore[no-untyped-call,unused-ignore]


doubles = Lanes("Lanes", ir.DoubleType(), LANES)
singles = Lanes("SingleLanes", ir.FloatType(), SINGLE_LANES)


def _load(lanes: Lanes) -> Any:
    def read(context: Any, address: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            return builder.load(builder.inttoptr(values[0], lanes.vector.as_pointer()), align=BYTES)

        return lanes(types.int64), generate

    return intrinsic(read)


def _store(lanes: Lanes) -> Any:
    def write(context: Any, address: Any, vector: Any) -> Any:  # noqa: ARG001
        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            pointer = builder.inttoptr(values[0], lanes.vector.as_pointer())
            builder.store(values[1], pointer, align=BYTES)
            return context.get_dummy_value()

        return types.void(types.int64, lanes), generate

    return intrinsic(write)


def _fma(lanes: Lanes) -> Any:
    def add_product(context: Any, first: Any, second: Any, added: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            kind = ir.FunctionType(lanes.vector, [lanes.vector] * 3)
            name = f"llvm.fmuladd.v{lanes.count}f{64 if lanes is doubles else 32}"
            function = cgutils.get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call]
            return builder.call(function, values)

        return lanes(lanes, lanes, lanes), generate

    return intrinsic(add_product)


def _binary(lanes: Lanes, operation: str) -> Any:
    def combine(context: Any, first: Any, second: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            return getattr(builder, operation)(*values)

        return lanes(lanes, lanes), generate

    return intrinsic(combine)


def _constant(lanes: Lanes, number: float) -> Any:
    def give(context: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, __: Any, ___: Any, ____: Any) -> Any:
            return ir.Constant(lanes.vector, [number] * lanes.count)

        return lanes(), generate

    return intrinsic(give)


def _spread(lanes: Lanes) -> Any:
    def repeat(context: Any, number: Any) -> Any:  # noqa: ARG001
        def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
            nothing = ir.Constant(lanes.vector, ir.Undefined)
            first = builder.insert_element(nothing, values[0], ir.Constant(ir.IntType(32), 0))
            mask = ir.Constant(ir.VectorType(ir.IntType(32), lanes.count), [0] * lanes.count)
            return builder.shuffle_vector(first, nothing, mask)

        return lanes(types.float64 if lanes is doubles else types.float32), generate

    return intrinsic(repeat)


# mypy sees the functions as kernels do: vectors are opaque.
load = cast("Callable[[int], Any]", _load(doubles))
"""Read four doubles at an address."""
store = cast("Callable[[int, Any], None]", _store(doubles))
"""Write four doubles at an address."""
fma = cast("Callable[[Any, Any, Any], Any]", _fma(doubles))
"""Give first * second + added, rounded once where the processor can."""
multiply = cast("Callable[[Any, Any], Any]", _binary(doubles, "fmul"))
"""Give first * second."""
zero = cast("Callable[[], Any]", _constant(doubles, 0.0))
"""Give four zeros."""
spread = cast("Callable[[float], Any]", _spread(doubles))
"""Give a double four times."""

load_singles = cast("Callable[[int], Any]", _load(singles))
"""Read eight numbers at an address."""
store_singles = cast("Callable[[int, Any], None]", _store(singles))
"""Write eight numbers at an address."""
fma_singles = cast("Callable[[Any, Any, Any], Any]", _fma(singles))
"""Give first * second + added, rounded once where the processor can."""
multiply_singles = cast("Callable[[Any, Any], Any]", _binary(singles, "fmul"))
"""Give first * second."""
add_singles = cast("Callable[[Any, Any], Any]", _binary(singles, "fadd"))
"""Give first + second."""
subtract_singles = cast("Callable[[Any, Any], Any]", _binary(singles, "fsub"))
"""Give first - second."""
divide_singles = cast("Callable[[Any, Any], Any]", _binary(singles, "fdiv"))
"""Give first / second."""
zero_singles = cast("Callable[[], Any]", _constant(singles, 0.0))
"""Give eight zeros."""
spread_single = cast("Callable[[Any], Any]", _spread(singles))
"""Give a number eight times; it must be of single precision."""
