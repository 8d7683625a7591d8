"""Mullins effect: below the largest strain so far the material is softer than on its first passage.

Ogden-Roxburgh: stiffness factor eta = 1 - s erf((M^2 - A^2) / w^2), A the size of the strain as a bend
(``large_strain``), M the largest so far, s the strength and w a width; eps = u / eta.
"""

import numpy as np
from scipy.special import erf

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.large_strain import size
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Soften by the distance to the largest strain so far."""
    strength, width = theta
    strain = size(signals.strains, spot.world)
    largest = np.maximum.accumulate(strain, axis=0)
    if memory:
        largest = np.maximum(largest, memory[0])
    factor = 1.0 - strength * spot.segments * erf((largest**2 - strain**2) / width**2)
    return signals.strains / factor[..., None], (largest[-1],)


EFFECT = Effect(
    name="mullins_softening",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.15, 0.0, 0.8, spread=0.2),
        ParameterSpec("width", "rad", 0.3, 0.02, 3.0, "shape", "log", spread=0.7),
    ),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} shows the Mullins effect: below the largest strain so far its "
    "stiffness is up to {strength:percent} lower, over a bend of {width}.",
    source="R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. A 455 (1999) 2861",
    needs=frozenset({"growing_cycles"}),
    splits=(
        ("viscoelastic_creep", "growing cycles on the rested arm, repeated at once"),
        ("material_stiffening", "the same cycles a second time"),
    ),
    when="largest strain so far",
    shapes=((0.15,), (0.5,)),
)
