"""A segment that locks beyond a curvature, as when fibres meet."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_segments
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``stiffness`` over that at rest beyond ``curvature``."""
    if numbers["stiffness"] == 0.0:
        return arm
    return change_segments(
        arm,
        where,
        lambda segment: replace(
            segment, locking=numbers["stiffness"], locking_curvature=numbers["curvature"]
        ),
    )


EFFECT = ArmEffect(
    "curvature_locking",
    "stiffness",
    {"stiffness": EffectParameter("", 1.0, 0.4, 3.0), "curvature": EffectParameter("1/m", 2.5, 1.5, 3.5)},
    ("segment",),
    change=change,
)
