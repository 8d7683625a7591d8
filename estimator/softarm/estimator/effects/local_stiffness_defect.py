"""A soft, stiff or glued strip along one side of a segment.

A fibre at the radius r of a thin ring stretches by s = r n . t + d under the bend t and the elongation d,
with n the axis about which the segment bends when that side grows longer. A strip of other stiffness adds a
rank-one term in s to the stiffness of the ring, whose bending stiffness is r^2 / 2 of its axial one; inverted
(Sherman and Morrison), the bend changes by q n (n . t + d / r) and the elongation by q r (n . t + d / r) / 2,
with q = D / (1 - D) and D the share of bending stiffness lost about the axis.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add strain about the weak axis, and along the segment."""
    depth, azimuth = theta
    radii = spot.world.radii
    bend = np.array([np.cos(azimuth), np.sin(azimuth)])
    along = signals.strains[..., :2] @ bend + signals.strains[..., 3] / radii
    extra = np.zeros_like(signals.strains)
    extra[..., :2] = along[..., None] * bend
    extra[..., 3] = 0.5 * radii * along
    return signals.strains + depth / (1.0 - depth) * spot.segments[:, None] * extra, memory


def modal(theta: Floats) -> ModalChange:
    """Weaken the stiffness."""
    return ModalChange(stiffness_ratio=1.0 - float(theta[0]))


EFFECT = Effect(
    name="local_stiffness_defect",
    hook="constitutive",
    parameters=(
        ParameterSpec("depth", "1", 0.2, -2.0, 0.9, spread=0.3),
        ParameterSpec("azimuth", "rad", 0.5, -2.0 * np.pi, 2.0 * np.pi, "shape", "linear", spread=1.8),
    ),
    places=segments,
    act=act,
    statement="The wall of {where} is defective on one side: its bending stiffness about the axis at "
    "{azimuth} is {depth:higher|lower}, and it bends about that axis when it is stretched.",
    source="Rank-one change of the stiffness of a thin ring; J. Sherman and W. J. Morrison, Ann. Math. Stat. "
    "21 (1950) 124",
    needs=frozenset({"each_chamber"}),
    splits=(
        ("chamber_gain", "bend the arm by gravity, mount turned"),
        ("contact_obstacle", "mount turned by 90 degrees"),
    ),
    when="pose",
    shapes=tuple((float(angle),) for angle in np.radians(np.arange(-150.0, 181.0, 60.0))),
    modal=modal,
)
