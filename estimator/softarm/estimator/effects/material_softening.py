"""Softening of the rubber: eps = u (1 + k q^(n/2)), q the loss of stiffness of ``large_strain``.

Every strain grows beyond the linear one u by a power of its size, as in the law of Ramberg and Osgood: with n
of 2 it is the leading term of Yeoh's law, with n of 1 a modulus that falls from the first strain on.
"""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.large_strain import losses
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add strain that grows with a power of strain."""
    growth, exponent = theta
    lost = losses(signals.strains, spot.world) ** (0.5 * exponent)
    return signals.strains * (1.0 + growth * spot.segments[:, None] * lost), memory


EFFECT = Effect(
    name="material_softening",
    hook="constitutive",
    parameters=(
        ParameterSpec("growth", "1", 0.2, 0.0, 20.0, spread=0.5),
        ParameterSpec("exponent", "1", 1.5, 0.5, 3.0, "shape", "log", spread=0.4),
    ),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} softens with strain: at a bend of one radian it bends "
    "{growth:percent} further than a linear material would. The effect grows with the bend to the power "
    "{exponent}, and with stretch.",
    source="W. Ramberg and W. R. Osgood, NACA Technical Note 902 (1943); O. H. Yeoh, Rubber Chem. Technol. "
    "66 (1993) 754",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("chamber_gain", "each chamber alone from small to large pressures"),
        ("mullins_softening", "the same cycles a second time"),
    ),
    when="pose",
    shapes=((1.0,), (2.0,)),
)
