"""An effect that the library does not have."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import Spot, chambers

HALF = 20e3


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Let a chamber push more, the fuller it is."""
    (growth,) = theta
    fuller = signals.pressures**2 / HALF
    return signals.pressures + growth * np.where(spot.chambers, fuller, 0.0), memory


EFFECT = Effect(
    name="chamber_growth",  # type: ignore[arg-type]
    hook="pressure",
    parameters=(ParameterSpec("growth", "1", 0.1, -0.5, 0.5, spread=0.1),),
    places=chambers,
    act=act,
    statement="{where} pushes more the fuller it is: {growth} at 20 kPa.",
    source="This test",
    when="pressure level",
    driven=True,
)
