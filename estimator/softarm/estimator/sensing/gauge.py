"""Force gauge that pulls along a line at one of the model's loads."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.sensing.measurement import Scene, Sensitivity

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class GaugeForce:
    """A gauge that reads a combination of load amplitudes: scale (direction . loads) + bias [N].

    Args:
        name: Name in reports.
        direction: Share of each load amplitude along the gauge's axis, shape (loads,).
        sigma: Standard deviation [N].
        scale: Factor of the gauge.
        bias: Offset of the gauge [N].
    """

    name: str
    direction: Floats
    sigma: float
    scale: float = 1.0
    bias: float = 0.0

    registration = None
    size = 1
    reading_size = 1
    parameter_names = ("scale", "bias")

    @property
    def parameters(self) -> Floats:
        """Scale, then bias [N], shape (2,)."""
        return np.array([self.scale, self.bias])

    def with_parameters(self, values: Floats) -> Self:
        """Give the same gauge with another scale and bias, shape (2,)."""
        return replace(self, scale=float(values[0]), bias=float(values[1]))

    def predict(self, scene: Scene) -> Floats:
        """Give the reading [N], shape (..., 1)."""
        reading: Floats = self.scale * (scene.loads @ self.direction)[..., None] + self.bias
        return reading

    def sensitivity(self, scene: Scene, reading: Floats) -> Sensitivity:
        """Compare a reading [N], shape (..., 1), with the scene."""
        leading = scene.loads.shape[:-1]
        twists = np.zeros((*leading, 1, 6 * scene.frames.positions.shape[-2]))
        loads = np.broadcast_to(self.scale * self.direction, (*leading, 1, len(self.direction)))
        return Sensitivity(reading - self.predict(scene), twists, loads)

    def parameter_rows(self, scene: Scene, reading: Floats) -> Floats:  # noqa: ARG002
        """Give the derivative by scale and bias, shape (..., 1, 2)."""
        along = (scene.loads @ self.direction)[..., None, None]
        return np.concatenate([along, np.ones_like(along)], axis=-1)

    def covariance(self, reading: Floats) -> Floats:
        """Give the variance of the noise [N2], shape (..., 1, 1)."""
        return np.full((*np.shape(reading)[:-1], 1, 1), self.sigma**2)
