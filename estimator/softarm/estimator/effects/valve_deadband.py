"""A valve that does not open at small set-points: p -> max(p - d, 0)."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Take the dead band off the pressures."""
    (band,) = theta
    return np.where(spot.chambers, np.maximum(signals.pressures - band, 0.0), signals.pressures), memory


EFFECT = Effect(
    name="valve_deadband",
    hook="command",
    parameters=(ParameterSpec("band", "Pa", 1500.0, 0.0, 20000.0, spread=1500.0),),
    places=whole_and_chambers,
    act=act,
    statement="The valve of {where} has a dead band: the first {band} of its set-point have no effect.",
    source="M. Bartys et al., Control Eng. Pract. 14 (2006) 577 (DAMADICS actuator faults)",
    needs=frozenset({"small_pressures"}),
    splits=(
        ("pressure_bias", "a staircase of small pressures"),
        ("material_stiffening", "a staircase of small pressures"),
    ),
    when="pressure level",
    driven=True,
)
