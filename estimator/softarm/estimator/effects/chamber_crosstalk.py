"""A chamber also bends another segment, like a share of its pressure in that segment's nearest chamber."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_segments_and_chambers,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add a share of each pressure to its neighbours in the other segments."""
    (share,) = theta
    world = spot.world
    owner = np.array(world.chamber_segment)
    pressures = signals.pressures.copy()
    for source in np.flatnonzero(spot.chambers):
        turn = np.cos(world.chamber_azimuth - world.chamber_azimuth[source])
        for segment in set(world.chamber_segment) - {int(owner[source])}:
            target = int(np.argmax(np.where(owner == segment, turn, -np.inf)))
            pressures[:, target] += share * signals.pressures[:, source]
    return pressures, memory


EFFECT = Effect(
    name="chamber_crosstalk",
    hook="pressure",
    parameters=(ParameterSpec("share", "1", 0.08, -1.0, 1.0, spread=0.1),),
    places=whole_segments_and_chambers,
    act=act,
    statement="Pressure in {where} also acts on the other segment: for each pascal, the nearest chamber "
    "there acts as if it had {share:number} Pa more.",
    source="Observed on a two-segment arm whose supply lines pass the upper segment",
    equivalence=("crosstalk_or_scale",),
    needs=frozenset({"each_chamber"}),
    splits=(("sensor_scale", "drive the lower segment alone, mount turned"),),
    when="pressure level",
    driven=True,
)
