"""Vectors of four doubles inside compiled kernels: one lane per element.

LLVM does not vectorise short loops over arrays that might overlap; spelling the vectors out makes the element
kernels several times faster on any processor, without reordering a single sum.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

LANES = 4
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
BYTES = 8
"""Alignment that NumPy guarantees."""


class Lanes(types.Type):
    """Type of four doubles."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)  # type: ignore[no-untyped-call,unused-ignore]


lanes = Lanes()


def _load(context: Any, address: Any) -> Any:  # noqa: ARG001
    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        return builder.load(builder.inttoptr(values[0], VECTOR.as_pointer()), align=BYTES)

    return lanes(types.int64), generate


def _store(context: Any, address: Any, vector: Any) -> Any:  # noqa: ARG001
    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        builder.store(values[1], builder.inttoptr(values[0], VECTOR.as_pointer()), align=BYTES)
        return context.get_dummy_value()

    return types.void(types.int64, lanes), generate


def _fma(context: Any, first: Any, second: Any, added: Any) -> Any:  # noqa: ARG001
    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v4f64")  # type: ignore[no-untyped-call]
        return builder.call(function, values)

    return lanes(lanes, lanes, lanes), generate


def _multiply(context: Any, first: Any, second: Any) -> Any:  # noqa: ARG001
    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        return builder.fmul(*values)

    return lanes(lanes, lanes), generate


def _zero(context: Any) -> Any:  # noqa: ARG001
    def generate(_: Any, __: Any, ___: Any, ____: Any) -> Any:
        return ir.Constant(VECTOR, [0.0] * LANES)

    return lanes(), generate


# mypy sees the functions as kernels do: vectors are opaque.
load = cast("Callable[[int], Any]", intrinsic(_load))
"""Read four doubles at an address."""
store = cast("Callable[[int, Any], None]", intrinsic(_store))
"""Write four doubles at an address."""
fma = cast("Callable[[Any, Any, Any], Any]", intrinsic(_fma))
"""Give first * second + added, rounded once where the processor can."""
multiply = cast("Callable[[Any, Any], Any]", intrinsic(_multiply))
"""Give first * second."""
zero = cast("Callable[[], Any]", intrinsic(_zero))
"""Give four zeros."""
