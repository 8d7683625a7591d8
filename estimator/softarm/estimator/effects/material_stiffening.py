"""Stiffening at large strain: eps (1 + k q(eps)) = u, q the gain of stiffness of ``large_strain``.

It is solved by Newton steps for the logarithm of the factor by which each strain shrinks, strain by strain,
with q of the step before.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.large_strain import losses
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)

STEPS = 12


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Shrink strains until the law holds."""
    (growth,) = theta
    factor = np.ones_like(signals.strains)
    for _ in range(STEPS):
        gain = growth * losses(signals.strains * factor, spot.world)
        # The gain goes with the square of the factors, so log(factor (1 + gain)) has this slope.
        slope = 1.0 + 2.0 * gain / (1.0 + gain)
        factor *= np.exp(-np.log(factor * (1.0 + gain)) / slope)
    factor = np.where(spot.segments[:, None], factor, 1.0)
    return signals.strains * factor, memory


EFFECT = Effect(
    name="material_stiffening",
    hook="constitutive",
    parameters=(ParameterSpec("growth", "1/rad2", 0.2, 0.0, 20.0, spread=0.5),),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} stiffens with strain: its stiffness grows by {growth:percent} at a "
    "bend of one radian, with the square of the bend, and with stretch.",
    source="Leading term of O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("mullins_softening", "the same cycles a second time"),
        ("contact_obstacle", "reach one pose by different chambers"),
        ("valve_deadband", "two opposite chambers together"),
    ),
    when="pose",
)
