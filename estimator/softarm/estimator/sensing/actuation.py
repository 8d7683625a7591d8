"""From a measured pressure to the pressure that acts in the chamber."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats

PASSES = 20
"""Each pass of the inverse leaves a tenth or less: cross-talk is small, and the curves are gentle."""
INVERTED_PA = 1e-9
"""Error of the inverse [Pa] at which the passes end."""
LEAST_SLOPE = 0.1
"""Of a gain; beyond the maximum of a falling curve the inverse continues along a line."""


@dataclass(frozen=True)
class ActuationMap:
    """Chamber pressure = gain * (1 + curve * m + quadratic_gain * m^2) * m + bias + crosstalk @ measured.

    Here m is the chamber's own measured gauge pressure. The curves describe how the winding yields: the area
    that the pressure pushes on grows with it. A chamber that lies a little beside its drawing also appears as
    cross-talk.

    Args:
        gain: Gain of each chamber at zero pressure, shape (chambers,).
        bias: Bias of each chamber [Pa], shape (chambers,).
        sigma: Standard deviation of a measured pressure [Pa], one number or shape (chambers,).
        curve: Relative growth of the gain with the pressure [1/Pa], one number or shape (chambers,).
        quadratic_gain: Relative growth of the gain with its square [1/Pa2], one number or shape (chambers,).
        crosstalk: Share of each pressure (column) that acts in another chamber (row), 0 for none or shape
            (chambers, chambers) with a zero diagonal.
    """

    gain: Floats
    bias: Floats
    sigma: Floats | float = 200.0
    curve: Floats | float = 0.0
    quadratic_gain: Floats | float = 0.0
    crosstalk: Floats | float = 0.0

    def to_chamber(self, measured: Floats) -> Floats:
        """Return the chamber pressures [Pa] of measured ones [Pa], shape (..., chambers)."""
        pressure: Floats = self._own(measured) + self.bias + self._from_others(measured)
        return pressure

    def to_measured(self, pressure: Floats) -> Floats:
        """Return the readings [Pa], or the set-points, that stand for chamber pressures [Pa]."""
        measured: Floats = (pressure - self.bias) / self.gain
        for _ in range(PASSES):
            residual = pressure - self.bias - self._from_others(measured) - self._own(measured)
            if not np.any(np.abs(residual) > INVERTED_PA):
                break
            # Newton's method in the chamber's own pressure alone: cross-talk is a small part of the whole.
            slope = 1.0 + (2.0 * self.curve + 3.0 * self.quadratic_gain * measured) * measured
            measured = measured + residual / (self.gain * np.maximum(slope, LEAST_SLOPE))
        return measured

    @cached_property
    def chamber_sigma(self) -> Floats:
        """Standard deviation of each chamber pressure near zero [Pa], shape (chambers,)."""
        return np.abs(self.gain) * self.sigma

    def _own(self, measured: Floats) -> Floats:
        pressure: Floats = (
            self.gain * (1.0 + (self.curve + self.quadratic_gain * measured) * measured) * measured
        )
        return pressure

    def _from_others(self, measured: Floats) -> Floats:
        """Return what the others add [Pa]; a lost reading adds nothing."""
        if not self._crosses:
            return np.zeros_like(measured)
        return np.asarray(np.where(np.isfinite(measured), measured, 0.0) @ np.transpose(self.crosstalk))

    @cached_property
    def _crosses(self) -> bool:
        return bool(np.any(self.crosstalk))
