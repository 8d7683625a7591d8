"""Mullins softening: the rubber is softer below the largest strain that it has seen."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_memory
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Drop a share ``strength`` of the stress over the distance ``strain`` below the largest strain."""
    return change_memory(
        arm,
        where,
        lambda memory: replace(
            memory, mullins=memory.mullins + numbers["strength"], mullins_strain=numbers["strain"]
        ),
    )


EFFECT = ArmEffect(
    "mullins_softening",
    "strength",
    {"strength": EffectParameter("", 0.15, 0.06, 0.30), "strain": EffectParameter("", 0.04, 0.02, 0.08)},
    ("segment",),
    change=change,
)
