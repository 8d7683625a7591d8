"""Silicone denser or lighter than its drawing says."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Scale the mass of all silicone by 1 + ``change``."""
    return replace(arm, density_factor=arm.density_factor * (1.0 + numbers["change"]))


EFFECT = ArmEffect(
    "distributed_mass", "change", {"change": EffectParameter("", 0.15, -0.2, 0.3)}, change=change
)
