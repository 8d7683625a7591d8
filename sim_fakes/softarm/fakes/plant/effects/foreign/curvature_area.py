"""Chambers that collapse as they bend: their area falls with the square of their stretch."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Lose ``loss`` times the squared stretch of the area."""
    first, second = arm.actuation.narrowing
    actuation = replace(arm.actuation, narrowing=(first, second + numbers["loss"]))
    return replace(arm, actuation=actuation)


EFFECT = ArmEffect("curvature_area", "loss", {"loss": EffectParameter("", 12.0, 5.0, 25.0)}, change=change)
