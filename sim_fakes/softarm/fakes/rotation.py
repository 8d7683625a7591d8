"""Unit quaternions (w, x, y, z) and what the instruments show of them."""

import math

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Multiply two quaternions (w, x, y, z): the rotation ``b`` followed by ``a``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Invert a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector by a unit quaternion."""
    rotated = multiply(multiply(q, (0.0, *v)), conjugate(q))
    return rotated[1], rotated[2], rotated[3]


def columns(q: Quaternion) -> tuple[float, ...]:
    """Return the rotation matrix by columns, which are the rotated axes: nine numbers."""
    w, x, y, z = q
    return (
        w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z,
    )  # fmt: skip


def roll_pitch_yaw(q: Quaternion) -> Vector:
    """Return the angles [rad] of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    w, x, y, z = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


def from_rotation_vector(rotation_vector: Vector) -> Quaternion:
    """Return the rotation about an axis by its length [rad]."""
    angle = math.hypot(*rotation_vector)
    if angle < 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    scale = math.sin(angle / 2.0) / angle
    x, y, z = rotation_vector
    return (math.cos(angle / 2.0), scale * x, scale * y, scale * z)
