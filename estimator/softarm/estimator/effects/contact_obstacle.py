"""A wall beside a section: f = -k max(n . x - d, 0) n.

n = (cos a, sin a, 0) points into the wall, d is its distance from the arm's axis at rest.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    AROUND,
    Spot,
    moving_sections,
)

SOFTEST = 25.0
"""Stiffness [N/m] below which what holds a section back is no obstacle."""


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Push the section back from the wall."""
    stiffness, distance, azimuth = theta
    normal = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    depth = np.maximum(signals.positions[:, spot.section] @ normal - distance, 0.0)
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    wrenches[:, spot.section, :3] = -stiffness * depth[:, None] * normal
    return wrenches, memory


EFFECT = Effect(
    name="contact_obstacle",
    hook="load",
    parameters=(
        ParameterSpec("stiffness", "N/m", 30.0, SOFTEST, 5000.0, transform="inverse", spread=100.0),
        ParameterSpec("distance", "m", 0.01, -0.5, 0.5, "shape", "linear", spread=0.1),
        ParameterSpec(
            "azimuth", "rad", 0.0, -3.141592653589793, 3.141592653589793, "shape", "linear", spread=2.0
        ),
    ),
    places=moving_sections,
    act=act,
    statement="An obstacle pushes {where} back: it starts {distance} from the rest position in the "
    "direction of {azimuth} and has a stiffness of {stiffness}.",
    source="Penalty contact with a half space",
    in_healthy_arms=False,
    needs=frozenset({"each_chamber"}),
    splits=(
        ("material_stiffening", "reach one pose by different chambers"),
        ("tether_stiffness", "the opposite side of the workspace"),
    ),
    when="pose",
    shapes=tuple((distance, angle) for distance in (0.01, 0.03, 0.05, 0.07) for angle in AROUND),
    responds_to_own_effect=True,
)
