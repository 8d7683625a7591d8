"""The two ways in which this package compiles a kernel."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(function: Kernel) -> Kernel:
    """Compile a kernel on first use, keep it on disk, and let it run without the interpreter's lock."""
    # numpy's error model: a division by zero gives infinity, which callers test for, and needs no branch.
    return cast("Kernel", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def reassociated(function: Kernel) -> Kernel:
    """Compile a kernel whose sums may be taken in any order, so that they run in parallel lanes."""
    # Not all of `fastmath`: NaN and infinity must survive, since they show that a solve has failed.
    loose = {"reassoc", "contract", "nsz"}
    return cast("Kernel", numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=loose)(function))
