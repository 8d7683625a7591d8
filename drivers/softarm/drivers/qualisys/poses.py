"""Bodies as QTM sends them, to poses in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, radians, sin, sqrt
from typing import Final

from softarm.drivers.qualisys.bodies import BodyFrame, Component

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_EULER: Final = frozenset({Component.SIX_D_EULER, Component.SIX_D_EULER_RESIDUAL})
_ORTHONORMAL_TOLERANCE: Final = 1e-2  # QTM sends single precision; a scrambled matrix is off by far more
_MILLIMETRE: Final = 1e-3


@dataclass(frozen=True, slots=True)
class BodyPose:
    """Where a rigid body is in the frame of the motion capture.

    Args:
        position: Origin of the body [m].
        quaternion: (w, x, y, z), unit length, w >= 0: rotates vectors from the body's axes to those of
            the room.
        residual: Mean distance of its markers from the fitted body [m], or None if not streamed.
    """

    position: Vector
    quaternion: Quaternion
    residual: float | None = None


def poses(frame: BodyFrame) -> list[BodyPose | None]:
    """Return one pose per body, None for a lost one.

    A body is lost if any of its numbers is not finite or its matrix is no rotation: a scrambled pose must not
    pass for a measurement.
    """
    to_pose = _from_angles if frame.component in _EULER else _from_matrix
    return [to_pose(row) for row in frame.values.tolist()]


def _from_matrix(row: list[float]) -> BodyPose | None:
    x, y, z, *columns = row
    quaternion = quaternion_from_columns(columns)
    # x - x is 0 for finite numbers and NaN for the others, at a fraction of the time of isfinite.
    if quaternion is None or not (x - x == y - y == z - z == 0.0):
        return None
    residual = columns[9] * _MILLIMETRE if len(columns) == 10 else None
    return BodyPose((x * _MILLIMETRE, y * _MILLIMETRE, z * _MILLIMETRE), quaternion, residual)


def _from_angles(row: list[float]) -> BodyPose | None:
    x, y, z, roll, pitch, yaw, *rest = row
    total = x + y + z + roll + pitch + yaw
    if total - total != 0.0:
        return None
    position = (x * _MILLIMETRE, y * _MILLIMETRE, z * _MILLIMETRE)
    residual = rest[0] * _MILLIMETRE if rest else None
    return BodyPose(position, quaternion_from_angles(roll, pitch, yaw), residual)


def quaternion_from_columns(columns: list[float]) -> Quaternion | None:
    """Return the quaternion of a rotation matrix given column by column, or None if it is no rotation.

    The largest of the four components is found first, from the diagonal, and the others from it, which keeps
    full accuracy near 180 degrees (S. W. Shepperd, "Quaternion from rotation matrix", J. Guidance and Control
    1978).
    """
    r11, r21, r31, r12, r22, r32, r13, r23, r33 = columns[:9]
    w2, x2, y2, z2 = (
        1 + r11 + r22 + r33,
        1 + r11 - r22 - r33,
        1 - r11 + r22 - r33,
        1 - r11 - r22 + r33,
    )
    largest = max(w2, x2, y2, z2)
    if not _is_rotation(r11, r21, r31, r12, r22, r32, r13, r23, r33):
        return None
    if largest == w2:
        q = (w2, r32 - r23, r13 - r31, r21 - r12)
    elif largest == x2:
        q = (r32 - r23, x2, r12 + r21, r13 + r31)
    elif largest == y2:
        q = (r13 - r31, r12 + r21, y2, r23 + r32)
    else:
        q = (r21 - r12, r13 + r31, r23 + r32, z2)
    w, x, y, z = q
    scale = (1.0 if w >= 0 else -1.0) / sqrt(w * w + x * x + y * y + z * z)
    return (w * scale, x * scale, y * scale, z * scale)


def quaternion_from_angles(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Quaternion:
    """Return the quaternion of R = R_x(roll) R_y(pitch) R_z(yaw), the Qualisys standard; in degrees."""
    ca, sa = _half(roll_deg)
    cb, sb = _half(pitch_deg)
    cc, sc = _half(yaw_deg)
    w = ca * cb * cc - sa * sb * sc
    x = sa * cb * cc + ca * sb * sc
    y = ca * sb * cc - sa * cb * sc
    z = ca * cb * sc + sa * sb * cc
    return (w, x, y, z) if w >= 0 else (-w, -x, -y, -z)


def _is_rotation(
    r11: float, r21: float, r31: float, r12: float, r22: float, r32: float, r13: float, r23: float, r33: float
) -> bool:
    """Return whether the first two columns are orthonormal and the third their cross product; NaN is not."""
    tolerance = _ORTHONORMAL_TOLERANCE
    return (
        abs(r11 * r11 + r21 * r21 + r31 * r31 - 1) < tolerance
        and abs(r12 * r12 + r22 * r22 + r32 * r32 - 1) < tolerance
        and abs(r11 * r12 + r21 * r22 + r31 * r32) < tolerance
        and abs(r21 * r32 - r31 * r22 - r13) < tolerance
        and abs(r31 * r12 - r11 * r32 - r23) < tolerance
        and abs(r11 * r22 - r21 * r12 - r33) < tolerance
    )


def _half(angle_deg: float) -> tuple[float, float]:
    half = radians(angle_deg) / 2
    return cos(half), sin(half)


@dataclass(frozen=True, slots=True)
class MotionFrame:
    """All bodies of one frame.

    Args:
        poses: By name; None for a body that the cameras have lost.
        lost_for_s: By name, how long the lost ones have been so [s].
        drop_rate: Missing camera data of the last second [per mille].
        out_of_sync_rate: Late camera data of the last second [per mille].
    """

    poses: Mapping[str, BodyPose | None]
    lost_for_s: Mapping[str, float]
    drop_rate: int = 0
    out_of_sync_rate: int = 0
