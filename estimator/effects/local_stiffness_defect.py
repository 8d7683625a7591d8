"""A soft or glued strip: the segment gives more about one axis.

With n = (cos phi, sin phi) the axis and d the share of stiffness lost about it,
eps = u + d / (1 - d) n n^T u.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.world import (
    Spot,
    segments,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add strain about the weak axis."""
    depth, azimuth = theta
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0, 0.0])
    along = signals.strains @ axis
    extra = depth / (1.0 - depth) * along[..., None] * axis
    return signals.strains + spot.segments[:, None] * extra, memory


EFFECT = Effect(
    name="local_stiffness_defect",
    hook="couple",
    parameters=(
        Parameter("depth", "1", 0.2, -2.0, 0.9, spread=0.3),
        Parameter(
            "azimuth", "rad", 0.5, -1.5707963267948966, 1.5707963267948966, "shape", "linear", spread=1.0
        ),
    ),
    places=segments,
    act=act,
    statement="The wall of {where} is defective: about the axis at {azimuth} rad it has lost the share "
    "{depth} of its stiffness.",
    source="Rank-one change of the bending stiffness",
    needs=frozenset({"each_chamber"}),
    splits=(
        ("chamber_gain", "bend the arm by gravity, mount turned"),
        ("contact_obstacle", "mount turned by 90 degrees"),
    ),
)
