"""A long line fills slowly: tau p' = p_in - p."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)
from softarm.estimator.simulation.filters import first_order


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Filter the pressures."""
    (lag,) = theta
    late, memory = first_order(signals.time, signals.pressures, lag, memory)
    return np.where(spot.chambers, late, signals.pressures), memory


EFFECT = Effect(
    name="line_lag",
    hook="command",
    parameters=(ParameterSpec("lag", "s", 0.3, 0.0, 20.0, spread=0.5),),
    places=whole_and_chambers,
    act=act,
    statement="Pressure arrives late in {where}: the line has a time constant of {lag}.",
    source="Isothermal filling through a restriction, linearised (ISO 6358)",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("inertia_damping", "compare with measured pressures, or release a weight"),
        ("sensor_latency", "compare with measured pressures"),
    ),
    when="rate",
    driven=True,
)
