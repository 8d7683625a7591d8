"""A sensor that shows too much or too little in proportion: y -> (1 + s) y.

A frame shows too much of its way and of its turn from where it was first seen.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import QUATERNION, turns
from softarm.estimator.effects.world import (
    Spot,
    sensors,
)
from softarm.estimator.rotations import exp, from_quaternions, log, to_quaternions


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Scale the reading."""
    factor, reading = 1.0 + theta[0], signals.reading
    if not turns(reading):
        return factor * reading, memory
    (first,) = memory or (reading[0],)
    rest = from_quaternions(first[-QUATERNION:])
    turned = log(rest.T @ from_quaternions(reading[:, -QUATERNION:]))
    place = first[:-QUATERNION] + factor * (reading[:, :-QUATERNION] - first[:-QUATERNION])
    return np.concatenate([place, to_quaternions(rest @ exp(factor * turned))], axis=-1), (first,)


EFFECT = Effect(
    name="sensor_scale",
    hook="sensing",
    parameters=(ParameterSpec("scale", "1", 0.05, -0.9, 2.0, spread=0.1),),
    places=sensors,
    act=act,
    statement="{where} reads {scale:too low|too high}.",
    source="Kinematics",
    equivalence=("crosstalk_or_scale",),
    needs=frozenset({"motion"}),
    splits=(
        ("chamber_crosstalk", "drive the lower segment alone, mount turned"),
        ("segment_stiffness", "two kinds of sensor on one motion"),
    ),
    when="pose",
)
