"""Limits of the inverse problem: bounds and held values of the inputs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.errors import InputError


@dataclass(frozen=True)
class InputBounds:
    """Bounds of the inputs; an input whose bounds are equal is held at that value.

    Args:
        lower: Smallest value of each input, -inf where free, shape (inputs,).
        upper: Largest value of each input, inf where free, shape (inputs,).

    Raises:
        InputError: If a lower bound is above its upper bound.
    """

    lower: Floats
    upper: Floats

    def __post_init__(self) -> None:
        crossed = np.flatnonzero(~(self.lower <= self.upper))
        if len(crossed):
            k = int(crossed[0])
            what = f"input {k} has the lower bound {self.lower[k]:g} above the upper bound {self.upper[k]:g}"
            raise InputError("limits", what, "give bounds that leave a value")

    @classmethod
    def free(cls, size: int) -> "InputBounds":
        """Leave all of ``size`` inputs free."""
        return cls(np.full(size, -np.inf), np.full(size, np.inf))

    def bound(self, members: slice | Indices, lower: Floats | float, upper: Floats | float) -> "InputBounds":
        """Bound some inputs as well.

        Args:
            members: Which inputs.
            lower: Their smallest values [Pa, N or N m], shape (members,) or one for all; -inf where free.
            upper: Their largest values, likewise; inf where free.

        Raises:
            InputError: A lower bound is above its upper bound.
        """
        low, high = self.lower.copy(), self.upper.copy()
        low[members], high[members] = lower, upper
        return InputBounds(low, high)

    def hold(self, members: slice, values: Floats | float) -> "InputBounds":
        """Hold some inputs at values [Pa, N or N m], shape (members,) or one for all (an equality)."""
        return self.bound(members, values, values)

    @cached_property
    def held(self) -> Flags:
        """Which inputs are held, shape (inputs,)."""
        held: Flags = self.lower == self.upper
        return held

    def reached(self, vector: Floats, scale: Floats) -> tuple[Flags, Flags]:
        """Return which free inputs lie on their lower and on their upper bound.

        Args:
            vector: The inputs [Pa, N or N m], shape (inputs,).
            scale: A typical change of each, shape (inputs,); a millionth of it counts as on the bound.

        Returns:
            Two flags of each input, shape (inputs,) each.
        """
        near, free = 1e-6 * scale, ~self.held
        return free & (vector <= self.lower + near), free & (vector >= self.upper - near)
