"""The orientation that an inertial unit believes in: mounting, noise, heading drift, heading at reset."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.state import PlantState
from softarm.fakes.rotation import Quaternion, Vector, from_rotation_vector, multiply, roll_pitch_yaw, rotate


@dataclass(frozen=True)
class Mounting:
    """Where an inertial unit sits and how well it measures.

    Args:
        section: Index of the rigid section that carries it.
        rotation: Its axes in the section's frame, as a rotation vector [rad].
        noise: Standard deviation of an angle [rad].
        drift: Drift of the heading [rad/s]; 0.5 degrees per minute is typical.
        acceleration_noise: Standard deviation of an acceleration [m/s2].
    """

    section: int
    rotation: Vector = (0.0, 0.0, 0.0)
    noise: float = 1e-3
    drift: float = 1.45e-4
    acceleration_noise: float = 0.02


class Attitude:
    """Senses one section.

    Args:
        mounting: Where and how well.
        seed: Seed of the noise.
        zero_heading: Whether the heading is 0 after a reset, as without a magnetometer.
    """

    def __init__(self, mounting: Mounting, seed: int, *, zero_heading: bool = True) -> None:
        self._mounting = mounting
        self._mount = from_rotation_vector(mounting.rotation)
        self._random = np.random.default_rng(seed)
        self._zero_heading = zero_heading
        self._heading: float | None = None
        self._since = 0.0

    def reset(self) -> None:
        """Make the next heading the zero."""
        self._heading = None

    def orientation(self, state: PlantState) -> Quaternion:
        """Measure the orientation: the rotation from the unit's axes to its estimate of the laboratory's."""
        w, x, y, z = (float(c) for c in state.quaternions[self._mounting.section])
        true = multiply((w, x, y, z), self._mount)
        if self._heading is None:
            self._heading = roll_pitch_yaw(true)[2] if self._zero_heading else 0.0
            self._since = state.time
        drift = self._mounting.drift * (state.time - self._since)
        wobble: Floats = self._mounting.noise * self._random.standard_normal(3)
        about_up = from_rotation_vector((0.0, 0.0, drift - self._heading))
        small = from_rotation_vector((float(wobble[0]), float(wobble[1]), float(wobble[2])))
        return multiply(multiply(about_up, true), small)

    def acceleration(self, state: PlantState) -> Vector:
        """Sense the specific force in the unit's axes [m/s2]."""
        x, y, z = (float(c) for c in state.specific_forces[self._mounting.section])
        w, a, b, c = self._mount
        gravity = rotate((w, -a, -b, -c), (x, y, z))
        noise = self._mounting.acceleration_noise * self._random.standard_normal(3)
        return (gravity[0] + float(noise[0]), gravity[1] + float(noise[1]), gravity[2] + float(noise[2]))

    def angular_velocity(self, state: PlantState) -> Vector:
        """Sense the angular velocity in the unit's axes [rad/s]."""
        x, y, z = (float(c) for c in state.angular_velocities[self._mounting.section])
        w, a, b, c = self._mount
        return rotate((w, -a, -b, -c), (x, y, z))
