"""Fibres wound at an angle turn pressure into torsion: the segment twists by t sum(p) of its chambers."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add a twist in proportion to the pressures."""
    (turn,) = theta
    strains = signals.strains.copy()
    for segment in np.flatnonzero(spot.segments):
        inside = np.array(spot.world.chamber_segment) == segment
        strains[:, segment, 2] += turn * signals.pressures[:, inside].sum(axis=1)
    return strains, memory


EFFECT = Effect(
    name="fibre_twist",
    hook="constitutive",
    parameters=(ParameterSpec("turn", "rad/Pa", 1e-06, -0.0001, 0.0001, spread=2e-06),),
    places=whole_and_segments,
    act=act,
    statement="The fibres of {where} convert pressure into twist: {turn}.",
    source="F. Connolly, C. J. Walsh, K. Bertoldi, PNAS 114 (2017) 51",
    needs=frozenset({"motion"}),
    splits=(("frame_misalignment", "bends in two azimuths at one sum of pressures"),),
    when="pressure level",
    driven=True,
)
