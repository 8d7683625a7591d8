"""A sample of any inertial unit: an orientation as a unit quaternion, and what else it sends."""

from dataclasses import dataclass
from math import cos, isfinite, radians, sin, sqrt

Quaternion = tuple[float, float, float, float]
"""(w, x, y, z), unit length: rotates vectors from the sensor's axes to its reference frame."""


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One orientation.

    Args:
        quaternion: (w, x, y, z), unit length.
        index: Sequence number as the instrument sends it, or None.
        device_time: Time of the instrument [s], wrapping or not, or None.
        acceleration: [m/s2] in the sensor's axes, or None.
        unit: Which of several sensors on one line, counted from 1.
    """

    quaternion: Quaternion
    index: int | None = None
    device_time: float | None = None
    acceleration: tuple[float, float, float] | None = None
    unit: int = 1


def quaternion_from_yaw_pitch_roll(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Quaternion:
    """Return q = q_z(yaw) q_y(pitch) q_x(roll): yaw first, about body axes; angles in degrees."""
    cy, sy = _half(yaw_deg)
    cp, sp = _half(pitch_deg)
    cr, sr = _half(roll_deg)
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def normalised(w: float, x: float, y: float, z: float, tolerance: float) -> Quaternion | None:
    """Return the unit quaternion along (w, x, y, z); None if its length is off one beyond `tolerance`."""
    length = sqrt(w * w + x * x + y * y + z * z)
    if not isfinite(length) or abs(length - 1.0) > tolerance:
        return None
    return (w / length, x / length, y / length, z / length)


def _half(angle_deg: float) -> tuple[float, float]:
    half = radians(angle_deg) / 2
    return cos(half), sin(half)
