"""What the values of a calibration's unknowns stand for in model, pressures and sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.response import BatchArmModel
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import ActuationMap, Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import StretchedBatch, StretchLaw


def gravity_axes(gravity: Floats) -> Floats:
    """Return two unit axes across gravity, shape (2, 3): x and y where it points along z."""
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-12)
    # From y, so that a hanging arm is tilted about x, then y; from z where gravity points along y.
    first = np.cross([0.0, 1.0, 0.0] if abs(down[1]) < 0.9 else [0.0, 0.0, 1.0], down)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(down, first)])


@dataclass(frozen=True)
class Setting:
    """What values of the unknowns stand for.

    Args:
        scales: Factor on the stiffness of each segment.
        actuation: From recorded to acting pressures.
        alignment: Values of sensors' parameters by ``<sensor>.<parameter>``.
        base: Twist (v [m], w [rad]) by which registered readings are moved, shape (6,): the mounting of the
            body on the base.
        gravity_axes: Axes about which gravity may be tilted, shape (2, 3). They belong to the base frame, so
            an arm in another mount is tilted about the same ones.
        gravity_tilt: Rotation of gravity about them [rad], shape (2,).
        cord_azimuth: Rotation of all known pulls about the base frame's z [rad].
        torsion: Share of each segment's torsional compliance that the model lacks.
        extension: Share of each segment's axial compliance that the model lacks.
        stretch: How stretch changes effective pressures; ``None`` for not at all.
    """

    scales: Mapping[str, float]
    actuation: ActuationMap
    alignment: Mapping[str, float] = field(default_factory=dict)
    base: Floats = field(default_factory=lambda: np.zeros(6))
    gravity_axes: Floats = field(default_factory=lambda: gravity_axes(np.array([0.0, 0.0, 1.0])))
    gravity_tilt: Floats = field(default_factory=lambda: np.zeros(2))
    cord_azimuth: float = 0.0
    torsion: Mapping[str, float] = field(default_factory=dict)
    extension: Mapping[str, float] = field(default_factory=dict)
    stretch: StretchLaw | None = None

    @classmethod
    def of(cls, specimen: Specimen, stretch: StretchLaw | None = None) -> "Setting":
        """Return the calibration that a specimen holds, with a stretch law where it counts."""
        return cls(
            {name: value.value for name, value in specimen.calibration.modulus_scale.items()},
            SpecimenSensors(specimen, (), Registration()).actuation(),
            gravity_axes=gravity_axes(np.array(specimen.gravity_m_s2)),
            stretch=stretch,
        )

    def model(self, model: BatchArmModel) -> BatchArmModel:
        """Return a model with the stiffness, its compliances where they can change, and the stretch law."""
        scaled = model.with_scales({n: f for n, f in self.scales.items() if n in model.regions})
        further = any(self.torsion.values()) or any(self.extension.values())
        # The rod's laws have such compliances, a finite-element model has none.
        if further and hasattr(scaled, "with_compliances"):
            scaled = cast(Any, scaled).with_compliances(self.torsion, self.extension)
        if self.stretch is None or not self.stretch.gain:
            return scaled
        return StretchedBatch(scaled, self.stretch)

    def aligned(self, suite: SensorSuite) -> SensorSuite:
        """Return a suite with the alignment, and registered with the base as it is mounted."""
        values = suite.parameters.copy()
        for index, name in enumerate(suite.parameter_names):
            values[index] = self.alignment.get(name, values[index])
        aligned = suite.with_parameters(values)
        return aligned.moved(self.base) if self.base.any() else aligned

    def gravity(self, gravity: Floats) -> Floats:
        """Tilt gravity [m/s2], shape (..., 3)."""
        tilted: Floats = gravity @ exp(self.gravity_tilt @ self.gravity_axes).T
        return tilted

    def pulls(self, loads: Floats) -> Floats:
        """Rotate known forces, three components a section, about z, shape (nodes, loads)."""
        if not loads.size:
            return loads
        rotation = exp(np.array([0.0, 0.0, self.cord_azimuth]))
        rotated: Floats = (loads.reshape(len(loads), -1, 3) @ rotation.T).reshape(loads.shape)
        return rotated
