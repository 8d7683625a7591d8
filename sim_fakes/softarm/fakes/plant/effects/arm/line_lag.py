"""A long or pinched line: the chamber follows its valve late."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_chambers
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``time`` to the time constant of the line."""
    lags = list(arm.actuation.lags)
    for chamber in chosen_chambers(arm, where):
        lags[chamber] += numbers["time"]
    return replace(arm, actuation=replace(arm.actuation, lags=tuple(lags)))


EFFECT = ArmEffect(
    "line_lag", "time", {"time": EffectParameter("s", 0.3, 0.03, 0.8)}, ("chamber",), change=change
)
