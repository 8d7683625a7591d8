"""A force on a section, constant once it has set in."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_section
from softarm.fakes.plant.parameters import ArmParameters, ForceLoad


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Pull with ``force`` times the direction (``x``, ``y``, ``z``, laboratory frame) from ``start`` on."""
    direction = (numbers["x"], numbers["y"], numbers["z"])
    size = sum(c * c for c in direction) ** 0.5
    amplitude = (
        numbers["force"] * direction[0] / size,
        numbers["force"] * direction[1] / size,
        numbers["force"] * direction[2] / size,
    )
    force = ForceLoad(chosen_section(arm, where), amplitude, start=numbers["start"])
    return replace(arm, loads=replace(arm.loads, forces=(*arm.loads.forces, force)))


EFFECT = ArmEffect(
    "external_force",
    "force",
    {
        "force": EffectParameter("N", 0.1, 0.02, 0.3),
        "x": EffectParameter("", 1.0, -1.0, 1.0),
        "y": EffectParameter("", 0.0, -1.0, 1.0),
        "z": EffectParameter("", 0.0, -0.5, 0.5),
        "start": EffectParameter("s", 0.0, 0.0, 0.0),
    },
    ("section",),
    change=change,
)
