"""Warming rubber changes its modulus with the clock: E = E0 (1 + c (1 - exp(-t / tau))), eps = u E0 / E.

A body that warms up to its surroundings nears their temperature exponentially (Newton's law of cooling).
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the strains with the clock."""
    change, lasting = theta
    warmed = 1.0 - np.exp(-np.maximum(signals.time, 0.0) / lasting)
    factor = 1.0 / (1.0 + change * warmed)[:, None, None]
    return np.where(spot.segments[:, None], factor * signals.strains, signals.strains), memory


EFFECT = Effect(
    name="thermal_drift",
    hook="constitutive",
    parameters=(
        ParameterSpec("change", "1", 0.1, -0.6, 2.0, spread=0.1),
        ParameterSpec("time_constant", "s", 400.0, 30.0, 20000.0, "shape", "log", 1.0),
    ),
    places=whole_and_segments,
    act=act,
    statement="The stiffness of {where} drifts over the run, independent of load: in the end it is "
    "{change:lower|higher}, with a time constant of {time_constant}.",
    source="First-order temperature dependence of the modulus; Newton's law of cooling",
    needs=frozenset({"long_run"}),
    splits=(
        ("viscoelastic_creep", "repeat the first minutes after an hour"),
        ("sensor_drift", "return to zero pressure every few minutes"),
    ),
    when="time of the run",
    shapes=((150.0,), (600.0,), (3000.0,)),
)
