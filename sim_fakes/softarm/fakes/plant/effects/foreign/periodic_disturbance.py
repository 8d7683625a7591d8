"""A draught or a machine that shakes a section at one frequency, whatever the arm does."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_section
from softarm.fakes.plant.parameters import ArmParameters, ForceLoad


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Shake with ``force`` along the laboratory's x axis at ``period``."""
    force = ForceLoad(chosen_section(arm, where), (numbers["force"], 0.0, 0.0), period=numbers["period"])
    return replace(arm, loads=replace(arm.loads, forces=(*arm.loads.forces, force)))


EFFECT = ArmEffect(
    "periodic_disturbance",
    "force",
    {"force": EffectParameter("N", 0.06, 0.03, 0.15), "period": EffectParameter("s", 7.0, 2.0, 20.0)},
    ("section",),
    change=change,
)
