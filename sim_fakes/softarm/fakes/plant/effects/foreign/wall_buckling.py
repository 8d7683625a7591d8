"""A chamber wall that snaps through above a pressure: its effective area jumps."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Grow the area of every chamber by ``growth`` above ``pressure``."""
    if numbers["growth"] == 0.0:
        return arm
    actuation = replace(arm.actuation, buckling=numbers["growth"], buckling_pressure=numbers["pressure"])
    return replace(arm, actuation=actuation)


EFFECT = ArmEffect(
    "wall_buckling",
    "growth",
    {"growth": EffectParameter("", 0.2, 0.1, 0.4), "pressure": EffectParameter("Pa", 32e3, 25e3, 40e3)},
    change=change,
)
