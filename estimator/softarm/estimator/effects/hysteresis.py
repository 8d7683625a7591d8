"""Hysteresis of the material: strain lags behind load by the same amount at every rate.

Bouc-Wen with n = 1 per bending axis: eps = u - a z, dz = du - |du| z / r, so that z runs towards +-r.
Its exact step over a change du of one sign is z' = s r + (z - s r) exp(-|du| / r), s = sign(du).
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Subtract the hysteretic share of the bending strains."""
    strength, reach = theta
    bends = signals.strains[..., :2]
    before, state = memory or (bends[0], np.zeros_like(bends[0]))
    change = np.diff(bends, axis=0, prepend=before[None])
    limit, kept = reach * np.sign(change), np.exp(-np.abs(change) / reach)
    lagging = np.empty_like(bends)
    for k in range(len(bends)):
        state = limit[k] + (state - limit[k]) * kept[k]
        lagging[k] = state
    strains = signals.strains.copy()
    strains[..., :2] -= strength * spot.segments[:, None] * lagging
    return strains, (bends[-1], state)


EFFECT = Effect(
    name="hysteresis",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.15, -0.5, 0.9, spread=0.2),
        ParameterSpec("reach", "rad", 0.1, 0.002, 2.0, "shape", "log", spread=1.0),
    ),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} has hysteresis: after each reversal its bend lags behind the load by "
    "up to {strength:percent} of {reach}, at any rate.",
    source="Y. K. Wen, J. Eng. Mech. 102 (1976) 249; M. Ismail et al., Arch. Comput. Meth. Eng. 16 (2009)",
    equivalence=("memory_at_one_rate",),
    needs=frozenset({"two_rates", "two_amplitudes"}),
    splits=(
        ("viscoelastic_creep", "ramps at two rates, then holds of three time constants"),
        ("line_lag", "ramps of 10 and 100 s against measured pressures"),
    ),
    when="direction of change",
    shapes=((0.03,), (0.1,), (0.3,)),
)
