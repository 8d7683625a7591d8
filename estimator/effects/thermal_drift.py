"""Warming rubber changes its modulus with the clock, E = E0 exp(-rate t): eps = u exp(rate t)."""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.world import (
    Spot,
    whole_and_segments,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the strains with the clock."""
    (rate,) = theta
    factor = np.exp(rate * signals.time)[:, None, None]
    return np.where(spot.segments[:, None], factor * signals.strains, signals.strains), memory


EFFECT = Effect(
    name="thermal_drift",
    hook="couple",
    parameters=(Parameter("rate", "1/s", 0.0001, -0.002, 0.002, spread=0.0002),),
    places=whole_and_segments,
    act=act,
    statement="The stiffness of {where} falls with the clock by the share {rate} per second, whatever "
    "the load.",
    source="First-order temperature dependence of the modulus under a steady warm-up",
    needs=frozenset({"long_run"}),
    splits=(
        ("viscoelastic_creep", "repeat the first minutes after an hour"),
        ("sensor_drift", "return to zero pressure every few minutes"),
    ),
)
