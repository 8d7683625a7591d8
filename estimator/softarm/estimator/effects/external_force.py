"""A constant force of unknown origin on a section, fixed in the base frame."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    moving_sections,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Push the section."""
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    wrenches[:, spot.section, :3] = theta
    return wrenches, memory


ALONG = 0.2
"""Lateral share of a force up to which it acts along the arm."""


def along(theta: Floats) -> bool:
    """Return whether the force only stretches the arm."""
    x, y, z = theta.tolist()
    return bool(np.hypot(x, y) < ALONG * abs(z))


EFFECT = Effect(
    name="external_force",
    hook="load",
    parameters=(
        ParameterSpec("force_x", "N", 0.05, -20.0, 20.0, spread=0.2),
        ParameterSpec("force_y", "N", 0.05, -20.0, 20.0, spread=0.2),
        ParameterSpec("force_z", "N", 0.05, -20.0, 20.0, spread=0.2),
    ),
    places=moving_sections,
    act=act,
    statement="A constant force acts on {where}: ({force_x:number}, {force_y:number}, {force_z:number}) N "
    "along x, y and z of the base.",
    source="Statics",
    needs=frozenset({"motion"}),
    splits=(
        ("tip_payload", "mount turned"),
        ("contact_obstacle", "reach one pose by different chambers"),
    ),
    along_arm=along,
)
