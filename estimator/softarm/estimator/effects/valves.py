"""Effects of the valves: what becomes of a set-point."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import Spot, whole_and_chambers

VENTED, OPEN = 100.0, 300.0
"""Pressures up to which a chamber counts as vented and from which as open [Pa]; the noise of a vented one's
sensor, and its steps of 100 Pa, stay below."""


def pressure_bias(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Shift the pressures of open valves by a constant: p -> max(p + b s, 0), s from 0 to 1.

    It sets in evenly between ``VENTED`` and ``OPEN``: set in at once, the noise of a vented chamber's sensor
    would open it.
    """
    (bias,) = theta
    pressures = signals.pressures
    opened = np.clip((pressures - VENTED) / (OPEN - VENTED), 0.0, 1.0)
    shifted = np.where(opened > 0.0, np.maximum(pressures + bias * opened, 0.0), pressures)
    return np.where(spot.chambers, shifted, pressures), memory


PRESSURE_BIAS = Effect(
    name="pressure_bias",
    hook="pressure",
    parameters=(ParameterSpec("bias", "Pa", -600.0, -20000.0, 20000.0, spread=1000.0),),
    places=whole_and_chambers,
    act=pressure_bias,
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


def pressure_saturation(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Cut the pressures, as a weak supply or valve does: p -> min(p, limit - shortfall)."""
    (shortfall,) = theta
    ceiling = np.where(spot.chambers, spot.world.pressure_limits - shortfall, np.inf)
    return np.minimum(signals.pressures, np.where(shortfall > 0.0, ceiling, np.inf)), memory


CUT = (0.9, 0.75, 0.6)
"""Shares of the highest recorded pressure at which a saturation is tried."""


def cuts(spot: Spot, highest: Floats) -> tuple[Floats, ...]:
    """List shortfalls [Pa] that would cut the recorded pressures, each of shape (1,)."""
    limits = spot.world.pressure_limits[spot.chambers]
    shortfalls = [float((limits - share * highest[spot.chambers]).max()) for share in CUT]
    return tuple(np.array([shortfall]) for shortfall in shortfalls if shortfall > 0.0)


PRESSURE_SATURATION = Effect(
    name="pressure_saturation",
    hook="command",
    shown_by_pressures=True,
    parameters=(ParameterSpec("shortfall", "Pa", 20000.0, 0.0, 500000.0, spread=20000.0),),
    places=whole_and_chambers,
    act=pressure_saturation,
    statement="The pressure in {where} stops {shortfall} below its limit.",
    source="Valve or supply limit",
    in_healthy_arms=False,
    needs=frozenset({"large_pressures"}),
    splits=(
        ("material_stiffening", "raise each chamber alone to its limit"),
        ("chamber_gain", "each chamber alone at several levels"),
    ),
    when="pressure level",
    presences=cuts,
    driven=True,
)


def valve_deadband(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Take off the dead band of a valve that does not open at small set-points: p -> max(p - d, 0)."""
    (band,) = theta
    return np.where(spot.chambers, np.maximum(signals.pressures - band, 0.0), signals.pressures), memory


VALVE_DEADBAND = Effect(
    name="valve_deadband",
    hook="command",
    shown_by_pressures=True,
    parameters=(ParameterSpec("band", "Pa", 1500.0, 0.0, 20000.0, spread=1500.0),),
    places=whole_and_chambers,
    act=valve_deadband,
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
