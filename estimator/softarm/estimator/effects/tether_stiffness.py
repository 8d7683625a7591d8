"""Hoses or a cord that pull a section to one side once slack is used up: f = k max(-n . x - l, 0) n.

n = (cos a, sin a, 0) points to where the cord is tied, far away; l is its slack while the arm hangs straight.
A cord is soft where an obstacle is hard: what holds back with less than ``SOFTEST`` is a cord.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects import contact_obstacle
from softarm.estimator.effects.contact_obstacle import SOFTEST
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    AROUND,
    Spot,
    moving_sections,
)

OPPOSITE = np.array([0.0, 0.0, np.pi])
"""From the parameters of a cord to those of the wall that would push to where it is tied."""


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Pull the section to where the cord is tied."""
    return contact_obstacle.act(signals, theta + OPPOSITE, spot, memory)


EFFECT = Effect(
    name="tether_stiffness",
    hook="load",
    parameters=(
        ParameterSpec("stiffness", "N/m", 5.0, 0.0, SOFTEST, spread=20.0),
        ParameterSpec("slack", "m", 0.01, 0.0, 0.5, "shape", "linear", spread=0.05),
        ParameterSpec("azimuth", "rad", 0.0, -np.pi, np.pi, "shape", "linear", spread=2.0),
    ),
    places=moving_sections,
    act=act,
    statement="Hoses or a cord pull {where} in the direction of {azimuth}: beyond {slack} of slack they "
    "pull with {stiffness}.",
    source="Unilateral spring",
    in_healthy_arms=False,
    needs=frozenset({"large_pressures"}),
    splits=(
        ("material_stiffening", "loosen the hoses and repeat"),
        ("contact_obstacle", "the opposite side of the workspace"),
    ),
    when="pose",
    shapes=tuple((slack, angle) for slack in (0.0, 0.02, 0.04) for angle in AROUND),
    responds_to_own_effect=True,
)
