"""A clamp that does not sit square in its mount."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import azimuth
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Turn the clamp by ``angle`` about the direction ``axis`` of the base plate."""
    direction = azimuth(where)
    tilt = (
        arm.support.tilt[0] + numbers["angle"] * float(np.cos(direction)),
        arm.support.tilt[1] + numbers["angle"] * float(np.sin(direction)),
    )
    return replace(arm, support=replace(arm.support, tilt=tilt))


EFFECT = ArmEffect(
    "base_tilt", "angle", {"angle": EffectParameter("rad", 0.05, 0.02, 0.1)}, ("axis",), change=change
)
