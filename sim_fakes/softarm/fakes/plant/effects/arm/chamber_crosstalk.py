"""Pressure of a chamber that also acts in the other segment, at the same azimuth."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_chambers
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Apply a ``share`` of the pressure to the chamber of the other segment, or on the next one.

    Without a chamber given, the lower chambers act in the upper segment, whose wall their lines run through.
    """
    first = len(arm.groups[0])
    step = first if len(arm.groups) > 1 else 1
    matrix = [list(row) for row in arm.actuation.crosstalk]
    sources = (
        chosen_chambers(arm, where)
        if "chamber" in where
        else tuple(range(first, arm.chambers)) or tuple(range(arm.chambers))
    )
    for chamber in sources:
        place = (chamber + step) % arm.chambers
        matrix[place][chamber] += numbers["share"]
    crosstalk = tuple(tuple(row) for row in matrix)
    return replace(arm, actuation=replace(arm.actuation, crosstalk=crosstalk))


EFFECT = ArmEffect(
    "chamber_crosstalk", "share", {"share": EffectParameter("", 0.08, 0.03, 0.2)}, ("chamber",), change=change
)
