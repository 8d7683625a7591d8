"""A patch of a segment that is softer or stiffer: a glue seam, a bubble, a repaired cut."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import azimuth, change_segments
from softarm.fakes.plant.parameters import ArmParameters, Defect


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the modulus by 1 + ``change`` within ``width`` [rad] of ``axis``, from ``start`` to ``end``."""
    patch = Defect(
        azimuth(where), numbers["width"], numbers["start"], numbers["end"], 1.0 + numbers["change"]
    )
    usual = where.get("segment", arm.segments[0].name)
    return change_segments(
        arm, {"segment": usual}, lambda segment: replace(segment, defects=(*segment.defects, patch))
    )


EFFECT = ArmEffect(
    "local_stiffness_defect",
    "change",
    {
        "change": EffectParameter("", -0.4, -0.6, 0.8),
        "width": EffectParameter("rad", 2.0, 1.2, 2.4),
        "start": EffectParameter("", 0.0, 0.0, 0.0),
        "end": EffectParameter("", 1.0, 1.0, 1.0),
    },
    ("segment", "axis"),
    change=change,
)
