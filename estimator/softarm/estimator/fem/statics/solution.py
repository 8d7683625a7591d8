"""The outcome of a numerical solve, as a value."""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

Value = TypeVar("Value")


class SolveStatus(Enum):
    """How a solve ended."""

    CONVERGED = "converged"
    UNSTABLE = "unstable"
    """The load step was halved to its smallest on account of an indefinite tangent: the arm buckles."""
    INVERTED = "inverted"
    """The load step was halved to its smallest on account of inverted elements."""
    STALLED = "stalled"
    """The load step was halved to its smallest without convergence."""
    ITERATIONS = "iterations"
    """The allowed number of iterations was spent."""


@dataclass(frozen=True)
class Solution(Generic[Value]):
    """The result of a solve.

    Args:
        value: The last iterate; an equilibrium only when ``status`` is ``CONVERGED``.
        status: How it ended.
        iterations: Number of linear solves.
        residual_norm: Out-of-balance force over the applied force at ``value``.
    """

    value: Value
    status: SolveStatus
    iterations: int
    residual_norm: float

    @property
    def converged(self) -> bool:
        """Whether ``value`` is an equilibrium."""
        return self.status is SolveStatus.CONVERGED
