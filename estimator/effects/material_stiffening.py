"""Stiffening at large strain: eps (1 + k |theta|^2) = u, theta the bend of the segment.

With A the free bend, k e^3 + e = A has the one real root
e = 2 / sqrt(3 k) sinh(asinh(3/2 A sqrt(3 k)) / 3); all strains shrink by e / A.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.world import (
    Spot,
    whole_and_segments,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Solve the cubic law for the bend."""
    (growth,) = theta
    size = np.hypot(signals.strains[..., 0], signals.strains[..., 1])
    root = np.sqrt(3.0 * growth)
    argument = 1.5 * root * size
    known = argument > 1e-6
    safe = np.where(known, argument, 1.0)
    shrink = np.where(known, 3.0 * np.sinh(np.arcsinh(safe) / 3.0) / safe, 1.0)
    factor = np.where(spot.segments, shrink, 1.0)
    return signals.strains * factor[..., None], memory


EFFECT = Effect(
    name="material_stiffening",
    hook="couple",
    parameters=(Parameter("growth", "1/rad2", 0.2, 0.0, 20.0, spread=0.5),),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} stiffens as it bends: its stiffness grows by {growth} per square"
    " radian of bend.",
    source="Leading term of O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("mullins_softening", "the same cycles a second time"),
        ("contact_obstacle", "reach one pose by different chambers"),
        ("valve_deadband", "two opposite chambers together"),
    ),
)
