"""Softening at large strain: eps = u (1 + k q), q the loss of stiffness of ``large_strain``."""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.large_strain import losses
from estimator.effects.world import (
    Spot,
    whole_and_segments,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add strain that grows with the square of strain."""
    (growth,) = theta
    lost = losses(signals.strains, spot.world)
    return signals.strains * (1.0 + growth * spot.segments[:, None] * lost), memory


EFFECT = Effect(
    name="material_softening",
    hook="couple",
    parameters=(Parameter("growth", "1/rad2", 0.2, 0.0, 20.0, spread=0.5),),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} softens as it strains: its bend exceeds the linear one by {growth} "
    "per square radian of bend, and more where it is stretched.",
    source="Leading term of O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("chamber_gain", "each chamber alone from small to large pressures"),
        ("mullins_softening", "the same cycles a second time"),
    ),
)
