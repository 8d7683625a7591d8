"""A sensor that stops following at some time: a share of its reading stays what it was then."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    sensors,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Hold a share of the reading."""
    share, since = theta
    held = memory[0] if memory else signals.reading[0]
    stopped = signals.time >= since
    before = signals.reading[~stopped]
    held = before[-1] if len(before) else held
    kept = (1.0 - share) * signals.reading + share * held
    return np.where(stopped[:, None] & (share > 0.0), kept, signals.reading), (held,)


EFFECT = Effect(
    name="sensor_stuck",
    hook="sensing",
    parameters=(
        ParameterSpec("share", "1", 1.0, 0.0, 1.0, spread=0.5),
        ParameterSpec("since", "s", 0.1, 0.0, 100000.0, "shape", "linear", spread=1000.0),
    ),
    places=sensors,
    act=act,
    statement="{where} is stuck from {since} on: {share:percent} of its reading no longer follows the arm.",
    source="Fault model of stuck sensors",
    needs=frozenset({"motion"}),
    splits=(("sensor_scale", "move the arm after a rest"),),
    when="time of the run",
    by_fit=False,
    hides_reading=True,
)
