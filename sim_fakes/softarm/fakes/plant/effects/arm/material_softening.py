"""Softening of the rubber with strain: the static response bends upwards."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_segments
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Divide the stress at 20 % strain by 1 + strength, less below."""
    return change_segments(
        arm, where, lambda segment: replace(segment, softening=segment.softening + numbers["strength"])
    )


EFFECT = ArmEffect(
    "material_softening",
    "strength",
    {"strength": EffectParameter("", 0.4, 0.15, 1.0)},
    ("segment",),
    change=change,
)
