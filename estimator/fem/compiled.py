"""The one way in which this package compiles a kernel."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(function: Kernel) -> Kernel:
    """Compile a kernel on first use, keep it on disk, and let it run without the interpreter's lock."""
    return cast("Kernel", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
