"""A chamber whose pressure is worth more or less than its drawing says."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_chambers
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the effective area by 1 + ``change``."""
    gains = list(arm.actuation.gains)
    for chamber in chosen_chambers(arm, where):
        gains[chamber] *= 1.0 + numbers["change"]
    return replace(arm, actuation=replace(arm.actuation, gains=tuple(gains)))


EFFECT = ArmEffect(
    "chamber_gain", "change", {"change": EffectParameter("", -0.12, -0.3, 0.2)}, ("chamber",), change=change
)
