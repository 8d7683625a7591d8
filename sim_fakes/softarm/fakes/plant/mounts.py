"""Ways to clamp the arm."""

import numpy as np

from softarm.fakes.plant.parameters import Mount
from softarm.fakes.plant.rotations import product, vector_quaternion

HANGING = np.array([0.0, 1.0, 0.0, 0.0])


def turned(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mount:
    """Rotate the hanging mount by a rotation vector in the base frame [rad]."""
    w, a, b, c = product(HANGING, vector_quaternion(np.array([x, y, z])))
    return Mount(quaternion=(float(w), float(a), float(b), float(c)))


MOUNTS: dict[str, Mount] = {
    "hanging": Mount(),
    "slanted": turned(x=np.pi / 4.0),
    "sideways": turned(y=np.pi / 2.0),
    "sideways_x": turned(x=np.pi / 2.0),
    "turned": turned(z=np.pi / 2.0),
}
