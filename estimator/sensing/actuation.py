"""From a measured pressure to the pressure that acts in the chamber."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ActuationMap:
    """Chamber pressure = gain * (1 + curve * measured) * measured gauge pressure + bias.

    The curve is what the winding gives way: the area that the pressure pushes on grows with it.

    Args:
        gain: Gain of each chamber at zero pressure, shape (chambers,).
        bias: Bias of each chamber [Pa], shape (chambers,).
        sigma: Standard deviation of a measured pressure [Pa].
        curve: Relative growth of the gain with the pressure [1/Pa], one number or shape (chambers,).
    """

    gain: Floats
    bias: Floats
    sigma: float = 200.0
    curve: Floats | float = 0.0

    @classmethod
    def identity(cls, chambers: int, sigma: float = 200.0) -> "ActuationMap":
        """Take the measured pressures as they are."""
        return cls(np.ones(chambers), np.zeros(chambers), sigma)

    def to_chamber(self, measured: Floats) -> Floats:
        """Give the chamber pressures [Pa] of measured ones [Pa], shape (..., chambers)."""
        pressure: Floats = self.gain * (1.0 + self.curve * measured) * measured + self.bias
        return pressure

    def slope(self, measured: Floats) -> Floats:
        """Give the chamber pressure's change per measured pressure, shape (..., chambers)."""
        slope: Floats = self.gain * (1.0 + 2.0 * self.curve * measured)
        return slope

    def to_measured(self, pressure: Floats) -> Floats:
        """Give the readings [Pa], or the set-points, that stand for chamber pressures [Pa]."""
        line = (pressure - self.bias) / self.gain
        inside = np.maximum(1.0 + 4.0 * self.curve * line, 0.0)
        measured: Floats = 2.0 * line / (1.0 + np.sqrt(inside))
        return measured

    @property
    def chamber_sigma(self) -> Floats:
        """Standard deviation of each chamber pressure near zero [Pa], shape (chambers,)."""
        return np.abs(self.gain) * self.sigma

    def parameter_rows(self, measured: Floats) -> Floats:
        """Give the derivative of the chamber pressures by gains, then biases.

        Args:
            measured: Measured pressures [Pa], shape (..., chambers).

        Returns:
            Shape (..., chambers, 2 chambers).
        """
        identity = np.eye(measured.shape[-1])
        pushed = (1.0 + self.curve * measured) * measured
        return np.concatenate(
            [pushed[..., None] * identity, np.broadcast_to(identity, (*measured.shape, len(identity)))],
            axis=-1,
        )
