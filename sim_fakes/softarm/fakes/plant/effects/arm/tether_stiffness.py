"""A tube or cable that pulls on a section once it is taut."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import azimuth, chosen_section
from softarm.fakes.plant.parameters import ArmParameters, Tether


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Tie a section to a point ``reach`` beside its rest position, with ``slack`` to spare."""
    if numbers["stiffness"] == 0.0:
        return arm
    section, angle = chosen_section(arm, where), azimuth(where)
    height = arm.frames[arm.sections.index(section)].origin[2]
    anchor = (numbers["reach"] * float(np.cos(angle)), numbers["reach"] * float(np.sin(angle)), height)
    tether = Tether(section, anchor, numbers["reach"] + numbers["slack"], numbers["stiffness"])
    return replace(arm, loads=replace(arm.loads, tethers=(*arm.loads.tethers, tether)))


EFFECT = ArmEffect(
    "tether_stiffness",
    "stiffness",
    {
        "stiffness": EffectParameter("N/m", 4.0, 1.0, 15.0),
        "reach": EffectParameter("m", 0.3, 0.3, 0.3),
        "slack": EffectParameter("m", 0.02, 0.0, 0.04),
    },
    ("section", "axis"),
    change=change,
)
