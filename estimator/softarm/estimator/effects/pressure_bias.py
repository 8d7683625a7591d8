"""A valve's pressure is off by a constant while it is open, none while vented: p -> p + b where p > 0."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)

OPEN = 100.0  # Pa; below it a chamber counts as vented


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Shift pressures above zero."""
    (bias,) = theta
    return signals.pressures + bias * (spot.chambers & (signals.pressures > OPEN)), memory


EFFECT = Effect(
    name="pressure_bias",
    hook="pressure",
    parameters=(ParameterSpec("bias", "Pa", -600.0, -20000.0, 20000.0, spread=1000.0),),
    places=whole_and_chambers,
    act=act,
    statement="The pressure in {where} is off by {bias} whenever the chamber is not vented.",
    source="Valve bank steps: errors of -450 to -850 Pa",
    needs=frozenset({"rest"}),
    splits=(
        ("sensor_bias", "vent, then command small pressures"),
        ("valve_deadband", "a staircase of small pressures"),
    ),
    when="pressure level",
    driven=True,
)
