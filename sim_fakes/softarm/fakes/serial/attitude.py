"""The orientation that an inertial unit estimates: mounting, noise, heading drift, heading at reset."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.parts import InertialPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.rotation import (
    Quaternion,
    Vector,
    conjugate,
    from_rotation_vector,
    multiply,
    roll_pitch_yaw,
    rotate,
)

ACCELERATION_NOISE = 0.02
"""Standard deviation of an acceleration [m/s2]."""


class Attitude:
    """Senses one section.

    Args:
        part: How the unit is mounted and how well it measures.
        section: Index of the rigid section that carries it.
        seed: Seed of the noise.
        zero_heading: Whether the heading is 0 after a reset, as without a magnetometer.
    """

    def __init__(self, part: InertialPart, section: int, seed: int, *, zero_heading: bool = True) -> None:
        self._part = part
        self._section = section
        self._mount = from_rotation_vector(part.rotation_rad)
        self._random = np.random.default_rng(seed)
        self._zero_heading = zero_heading
        self._heading: float | None = None
        self._since = 0.0

    def reset(self) -> None:
        """Make the next heading the zero."""
        self._heading = None

    def orientation(self, state: PlantState) -> Quaternion:
        """Measure the orientation: the rotation from the unit's axes to its estimate of the laboratory's."""
        w, x, y, z = (float(c) for c in state.quaternions[self._section])
        true = multiply((w, x, y, z), self._mount)
        if self._heading is None:
            self._heading = roll_pitch_yaw(true)[2] if self._zero_heading else 0.0
            self._since = state.time
        drift = self._part.drift_rad_per_s * (state.time - self._since)
        wobble: Floats = self._part.noise_rad * self._random.standard_normal(3)
        about_up = from_rotation_vector((0.0, 0.0, drift - self._heading))
        small = from_rotation_vector((float(wobble[0]), float(wobble[1]), float(wobble[2])))
        return multiply(multiply(about_up, true), small)

    def acceleration(self, state: PlantState) -> Vector:
        """Sense the specific force in the unit's axes [m/s2]."""
        x, y, z = (float(c) for c in state.specific_forces[self._section])
        gravity = rotate(conjugate(self._mount), (x, y, z))
        noise = ACCELERATION_NOISE * self._random.standard_normal(3)
        return (gravity[0] + float(noise[0]), gravity[1] + float(noise[1]), gravity[2] + float(noise[2]))

    def angular_velocity(self, state: PlantState) -> Vector:
        """Sense the angular velocity in the unit's axes [rad/s]."""
        x, y, z = (float(c) for c in state.angular_velocities[self._section])
        return rotate(conjugate(self._mount), (x, y, z))
