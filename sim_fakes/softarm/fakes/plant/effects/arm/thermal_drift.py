"""Moduli that drift with the temperature over the run."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.parameters import ArmParameters, Warming


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Change all moduli by ``change`` with the time constant ``time`` from time 0."""
    return replace(arm, warming=Warming(arm.warming.change + numbers["change"], numbers["time"]))


EFFECT = ArmEffect(
    "thermal_drift",
    "change",
    {"change": EffectParameter("", 0.2, -0.3, 0.4), "time": EffectParameter("s", 400.0, 200.0, 800.0)},
    change=change,
)
