"""What rubber that softens with the square of its strain makes of a segment's bend and elongation.

With the stress E e (1 - c e^2) in every fibre of a thin ring of radius r and length l, strained by
e = (d + t r sin) / l under the bend t and the elongation d, the integrals over the ring give with
k = 3 c r^2 / 4 l^2 the moment K_b t (1 - k (t^2 + 4 d^2 / r^2)) and the axial force
K_a d (1 - k (2 t^2 + 4/3 d^2 / r^2)); the sums in brackets are the loss of bending and of axial stiffness.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.world import World


def losses(strains: Floats, world: World) -> Floats:
    """Return the loss of stiffness at k = 1 of each strain, shape (..., segments, 4)."""
    bend = (strains[..., :2] ** 2).sum(axis=-1)
    stretch = (strains[..., 3] / world.radii) ** 2
    bending, axial = bend + 4.0 * stretch, 2.0 * bend + 4.0 / 3.0 * stretch
    return np.stack([bending, bending, bending, axial], axis=-1)


def size(strains: Floats, world: World) -> Floats:
    """Compute the root of twice the mean square strain of the ring, as a bend, shape (..., segments)."""
    bend = (strains[..., :2] ** 2).sum(axis=-1)
    return np.asarray(np.sqrt(bend + 2.0 * (strains[..., 3] / world.radii) ** 2), dtype=np.float64)
