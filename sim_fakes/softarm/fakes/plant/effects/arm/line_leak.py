"""A chamber that loses air: less pressure than its valve gives, and decay when the valve is shut."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import chosen_chambers
from softarm.fakes.plant.parameters import ArmParameters


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Lose pressure at ``rate``; in a hold the chamber keeps 1 / (1 + rate lag) of the valve's pressure."""
    rates = list(arm.actuation.leak_rates)
    for chamber in chosen_chambers(arm, where):
        rates[chamber] += numbers["rate"]
    return replace(arm, actuation=replace(arm.actuation, leak_rates=tuple(rates)))


EFFECT = ArmEffect(
    "line_leak", "rate", {"rate": EffectParameter("1/s", 8.0, 3.0, 25.0)}, ("chamber",), change=change
)
