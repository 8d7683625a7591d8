"""A base plate that turns under the moment of the arm."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``compliance`` about both axes."""
    about_x, about_y = arm.support.compliance
    more = numbers["compliance"]
    return replace(arm, support=replace(arm.support, compliance=(about_x + more, about_y + more)))


EFFECT = ArmEffect(
    "base_compliance",
    "compliance",
    {"compliance": EffectParameter("rad/(N m)", 0.3, 0.1, 1.0)},
    change=change,
)
