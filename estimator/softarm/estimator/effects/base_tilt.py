"""The base is mounted turned: a constant rotation about its x and y axes, gravity staying where it is.

Where the recording shows the base, part of the rotation may lie beneath what is seen: all of it where the
clamp sits askew in its mount, none where the mount itself is turned.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    everywhere,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Turn the base."""
    return np.tile(np.append(theta[:2], 0.0), (len(signals.time), 1)), memory


def hidden(theta: Floats) -> Floats:
    """Return the rotation that the recorded base does not show [rad], shape (3,)."""
    tilt_x, tilt_y, beneath = theta.tolist()
    return np.array([beneath * tilt_x, beneath * tilt_y, 0.0])


EFFECT = Effect(
    name="base_tilt",
    hook="support",
    parameters=(
        ParameterSpec("tilt_x", "rad", 0.05, -0.6, 0.6, spread=0.05),
        ParameterSpec("tilt_y", "rad", 0.05, -0.6, 0.6, spread=0.05),
        ParameterSpec("beneath", "1", 0.5, 0.0, 1.0, "shape", spread=1.0),
    ),
    places=everywhere,
    act=act,
    statement="The base is tilted relative to the model, by {tilt_x} about x and {tilt_y} about y.",
    source="Kinematics",
    equivalence=("constant_offset",),
    needs=frozenset({"mount_turned"}),
    splits=(("sensor_bias", "mount turned by 90 degrees"),),
    shapes=((0.0,), (1.0,)),
    hidden_rotation=hidden,
)
