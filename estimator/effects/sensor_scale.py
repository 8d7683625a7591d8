"""A sensor that shows too much or too little in proportion: y -> (1 + s) y."""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.readings import from_vector, to_vector
from estimator.effects.world import (
    Spot,
    sensors,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Scale the reading."""
    (scale,) = theta
    vector = to_vector(signals.reading)
    return from_vector((1.0 + scale) * vector, signals.reading, np.zeros(vector.shape[-1])), memory


EFFECT = Effect(
    name="sensor_scale",
    hook="sensing",
    parameters=(Parameter("scale", "1", 0.05, -0.9, 2.0, spread=0.1),),
    places=sensors,
    act=act,
    statement="{where} shows the share {scale} more than the truth.",
    source="Kinematics",
    equivalence=("crosstalk_or_scale",),
    needs=frozenset({"motion"}),
    splits=(
        ("chamber_crosstalk", "drive the lower segment alone, mount turned"),
        ("segment_stiffness", "two kinds of sensor on one motion"),
    ),
)
