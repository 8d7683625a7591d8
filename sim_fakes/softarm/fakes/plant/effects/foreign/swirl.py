"""Chambers that push at a slant: each also acts at one neighbour's azimuth, and against the other's."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Apply a ``share`` of each pressure at the next azimuth, and its negative at the one before."""
    matrix = [list(row) for row in arm.actuation.crosstalk]
    for group in arm.groups:
        for place, chamber in enumerate(group):
            matrix[group[(place + 1) % len(group)]][chamber] += numbers["share"]
            matrix[group[place - 1]][chamber] -= numbers["share"]
    crosstalk = tuple(tuple(row) for row in matrix)
    return replace(arm, actuation=replace(arm.actuation, crosstalk=crosstalk))


EFFECT = ArmEffect("swirl", "share", {"share": EffectParameter("", 0.06, 0.03, 0.12)}, change=change)
