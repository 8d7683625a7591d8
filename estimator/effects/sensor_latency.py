"""A sensor that reports late: y(t) -> y(t - delay), straight between samples."""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.readings import from_vector, to_vector
from estimator.effects.world import (
    Spot,
    sensors,
)

Floats = NDArray[np.float64]

LONGEST = 1.0  # s, the upper bound of the delay


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Delay the reading."""
    (delay,) = theta
    vector = to_vector(signals.reading)
    times, values = memory or (signals.time[:1] - LONGEST, vector[:1])
    times, values = np.concatenate([times, signals.time]), np.concatenate([values, vector])
    late = np.stack([np.interp(signals.time - delay, times, column) for column in values.T], axis=-1)
    recent = max(int(np.searchsorted(times, times[-1] - LONGEST)) - 1, 0)
    out = from_vector(late, signals.reading, np.zeros(vector.shape[-1]))
    return out, (times[recent:], values[recent:])


EFFECT = Effect(
    name="sensor_latency",
    hook="sensing",
    parameters=(Parameter("delay", "s", 0.1, 0.0, 1.0, spread=0.1),),
    places=sensors,
    act=act,
    statement="{where} reports late, by {delay} s.",
    source="Transport delay",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("line_lag", "compare with measured pressures"),
        ("inertia_damping", "two kinds of sensor on one motion"),
    ),
)
