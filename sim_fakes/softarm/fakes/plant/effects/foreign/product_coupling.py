"""Chambers of a segment that strengthen one another: each pushes more when its neighbours are full."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``share`` to the gain of a chamber per 50 kPa in the other chambers of its segment."""
    actuation = replace(arm.actuation, product=arm.actuation.product + numbers["share"])
    return replace(arm, actuation=actuation)


EFFECT = ArmEffect(
    "product_coupling", "share", {"share": EffectParameter("", 0.15, 0.08, 0.35)}, change=change
)
