"""A supply too weak or a valve that stops short of the chamber's limit: p -> min(p, limit - shortfall)."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Cut the pressures."""
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


EFFECT = Effect(
    name="pressure_saturation",
    hook="command",
    parameters=(ParameterSpec("shortfall", "Pa", 20000.0, 0.0, 500000.0, spread=20000.0),),
    places=whole_and_chambers,
    act=act,
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
