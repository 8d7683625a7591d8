"""A segment of another modulus."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_segments
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the modulus by 1 + ``change``."""
    return change_segments(
        arm, where, lambda segment: replace(segment, modulus=segment.modulus * (1.0 + numbers["change"]))
    )


EFFECT = ArmEffect(
    "segment_stiffness",
    "change",
    {"change": EffectParameter("", 0.2, -0.3, 0.4)},
    ("segment",),
    change=change,
)
