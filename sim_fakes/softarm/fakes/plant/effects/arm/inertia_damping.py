"""More or less viscous damping than the rubber should have."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_segments
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``time``: viscous force over elastic stiffness [s]."""
    return change_segments(
        arm, where, lambda segment: replace(segment, damping_time=segment.damping_time + numbers["time"])
    )


EFFECT = ArmEffect(
    "inertia_damping", "time", {"time": EffectParameter("s", 0.1, 0.015, 0.3)}, ("segment",), change=change
)
