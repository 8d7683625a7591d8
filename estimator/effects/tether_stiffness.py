"""Hoses or a cord that pull a section back once slack is used up: f = -k max(|x| - l, 0) x / |x|."""

import numpy as np
from numpy.typing import NDArray

from estimator.effects.effect import Effect, Memory, Parameter, Signals
from estimator.effects.world import (
    Spot,
    moving_sections,
)

Floats = NDArray[np.float64]


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Pull the section towards the axis."""
    stiffness, slack = theta
    lateral = signals.positions[:, spot.section, :2]
    away = np.linalg.norm(lateral, axis=1)
    pull = stiffness * np.maximum(away - slack, 0.0) / np.maximum(away, 1e-12)
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    wrenches[:, spot.section, :2] = -pull[:, None] * lateral
    return wrenches, memory


EFFECT = Effect(
    name="tether_stiffness",
    hook="load",
    parameters=(
        Parameter("stiffness", "N/m", 5.0, 0.0, 5000.0, spread=20.0),
        Parameter("slack", "m", 0.005, 0.0005, 0.5, "shape", "log", spread=1.0),
    ),
    places=moving_sections,
    act=act,
    statement="Hoses or a cord hold {where} back: beyond {slack} m from the axis they pull with "
    "{stiffness} N/m.",
    source="Unilateral spring",
    needs=frozenset({"large_pressures"}),
    splits=(
        ("material_stiffening", "loosen the hoses and repeat"),
        ("contact_obstacle", "the opposite side of the workspace"),
    ),
)
