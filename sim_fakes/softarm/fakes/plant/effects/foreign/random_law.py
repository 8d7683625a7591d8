"""A law that nobody chose: a smooth random function of random states pushes a segment."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Push with ``strength``, by the law that the whole part of ``law`` draws."""
    law = (numbers["strength"], int(numbers["law"]))
    return replace(arm, actuation=replace(arm.actuation, random_law=law))


EFFECT = ArmEffect(
    "random_law",
    "strength",
    {
        "strength": EffectParameter("Pa", 8e3, 4e3, 16e3),
        "law": EffectParameter("", 1.0, 0.0, 1e6),
    },
    change=change,
)
