"""A sensor that reports late: y(t) -> y(t - delay), straight between samples.

Of a frame both place and orientation are late; between samples its quaternion goes straight, with its sign
kept, and is brought back to unit length.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import QUATERNION, turns
from softarm.estimator.effects.world import (
    Spot,
    sensors,
)

LONGEST = 1.0  # s, the upper bound of the delay


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Delay the reading."""
    (delay,) = theta
    times, values = memory or (signals.time[:1] - LONGEST, signals.reading[:1])
    times, values = np.concatenate([times, signals.time]), np.concatenate([values, signals.reading])
    if turns(signals.reading):
        values = np.concatenate([values[:, :-QUATERNION], _unflipped(values[:, -QUATERNION:])], axis=-1)
    late = np.stack([np.interp(signals.time - delay, times, column) for column in values.T], axis=-1)
    if turns(signals.reading):
        late[:, -QUATERNION:] /= np.linalg.norm(late[:, -QUATERNION:], axis=-1, keepdims=True)
    recent = max(int(np.searchsorted(times, times[-1] - LONGEST)) - 1, 0)
    return late, (times[recent:], values[recent:])


def _unflipped(quaternions: Floats) -> Floats:
    """Return the quaternions of the same turns without a jump from q to -q, shape (samples, 4)."""
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=-1) < 0.0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(flips)])
    unflipped: Floats = quaternions * signs[:, None]
    return unflipped


EFFECT = Effect(
    name="sensor_latency",
    hook="sensing",
    parameters=(ParameterSpec("delay", "s", 0.1, 0.0, 1.0, spread=0.1),),
    places=sensors,
    act=act,
    statement="{where} reports its readings {delay} late.",
    source="Transport delay",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("line_lag", "compare with measured pressures"),
        ("inertia_damping", "two kinds of sensor on one motion"),
    ),
    when="rate",
)
