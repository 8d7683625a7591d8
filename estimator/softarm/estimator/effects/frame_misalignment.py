"""A sensor mounted turned about the arm's axis: its two bend axes, or its frame, are rotated."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import with_offset
from softarm.estimator.effects.world import Spot, sensors

BEND = 2  # entries of a reading of two bend angles


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Turn the reading about z."""
    (yaw,) = theta
    if signals.reading.shape[-1] == BEND:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return signals.reading @ turn.T, memory
    return with_offset(signals.reading, np.array([0.0, 0.0, yaw])), memory


EFFECT = Effect(
    name="frame_misalignment",
    hook="sensing",
    parameters=(ParameterSpec("yaw", "rad", 0.05, -1.6, 1.6, spread=0.1),),
    places=sensors,
    act=act,
    statement="{where} is mounted {yaw} off about the axis of the arm.",
    source="Kinematics",
    needs=frozenset({"each_chamber"}),
    splits=(
        ("fibre_twist", "bends in two azimuths at one sum of pressures"),
        ("chamber_crosstalk", "each chamber alone, mount turned"),
    ),
    when="pose",
)
