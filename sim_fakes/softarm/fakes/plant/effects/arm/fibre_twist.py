"""Fibres wound at an angle: pressure twists the arm."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``arm``: torque per pressure force of the chambers [m]."""
    return replace(arm, actuation=replace(arm.actuation, twist=arm.actuation.twist + numbers["arm"]))


EFFECT = ArmEffect("fibre_twist", "arm", {"arm": EffectParameter("m", 5e-4, 1.5e-4, 1.5e-3)}, change=change)
