"""A weight that nobody mentioned."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_section
from softarm.fakes.plant.parameters import ArmParameters, Payload


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Fix ``mass`` to a section, ``below`` its origin."""
    if numbers["mass"] == 0.0:
        return arm
    payload = Payload(chosen_section(arm, where), numbers["mass"], (0.0, 0.0, numbers["below"]))
    return replace(arm, loads=replace(arm.loads, payloads=(*arm.loads.payloads, payload)))


EFFECT = ArmEffect(
    "tip_payload",
    "mass",
    {"mass": EffectParameter("kg", 0.02, 0.003, 0.05), "below": EffectParameter("m", 0.005, 0.0, 0.02)},
    ("section",),
    change=change,
)
