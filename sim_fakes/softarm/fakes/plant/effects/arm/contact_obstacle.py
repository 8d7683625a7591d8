"""Something that the arm touches in part of its space."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import azimuth
from softarm.fakes.plant.parameters import ArmParameters, Obstacle


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Stand a plane beside the arm, ``distance`` from its axis in the direction ``axis``."""
    if numbers["stiffness"] == 0.0:
        return arm
    angle = azimuth(where)
    outward = np.array([np.cos(angle), np.sin(angle), 0.0])
    point = numbers["distance"] * outward
    wall = Obstacle(
        "plane",
        (float(point[0]), float(point[1]), 0.0),
        (float(-outward[0]), float(-outward[1]), 0.0),
        numbers["stiffness"],
    )
    return replace(arm, loads=replace(arm.loads, obstacles=(*arm.loads.obstacles, wall)))


EFFECT = ArmEffect(
    "contact_obstacle",
    "stiffness",
    {
        "stiffness": EffectParameter("N/m", 300.0, 100.0, 800.0),
        "distance": EffectParameter("m", 0.06, 0.04, 0.08),
    },
    ("axis",),
    change=change,
)
