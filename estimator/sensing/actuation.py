"""From a measured pressure to the pressure that acts in the chamber."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ActuationMap:
    """Chamber pressure = gain * measured gauge pressure + bias.

    Args:
        gain: Gain of each chamber, shape (chambers,).
        bias: Bias of each chamber [Pa], shape (chambers,).
        sigma: Standard deviation of a measured pressure [Pa].
    """

    gain: Floats
    bias: Floats
    sigma: float = 200.0

    @classmethod
    def identity(cls, chambers: int, sigma: float = 200.0) -> "ActuationMap":
        """Take the measured pressures as they are."""
        return cls(np.ones(chambers), np.zeros(chambers), sigma)

    def to_chamber(self, measured: Floats) -> Floats:
        """Give the chamber pressures [Pa] of measured ones [Pa], shape (..., chambers)."""
        pressure: Floats = self.gain * measured + self.bias
        return pressure

    def to_measured(self, pressure: Floats) -> Floats:
        """Give the readings [Pa], or the set-points, that stand for chamber pressures [Pa]."""
        measured: Floats = (pressure - self.bias) / self.gain
        return measured

    @property
    def chamber_sigma(self) -> Floats:
        """Standard deviation of each chamber pressure [Pa], shape (chambers,)."""
        return np.abs(self.gain) * self.sigma

    def parameter_rows(self, measured: Floats) -> Floats:
        """Give the derivative of the chamber pressures by gains, then biases.

        Args:
            measured: Measured pressures [Pa], shape (..., chambers).

        Returns:
            Shape (..., chambers, 2 chambers).
        """
        identity = np.eye(measured.shape[-1])
        return np.concatenate(
            [measured[..., None] * identity, np.broadcast_to(identity, (*measured.shape, len(identity)))],
            axis=-1,
        )
