"""Effects between valve and arm: what a pressure does, and how late."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import EffectParameter, Numbers, Where, arm_effect
from softarm.fakes.plant.effects.places import chosen_chambers
from softarm.fakes.plant.parameters import ArmParameters


@arm_effect(places=("chamber",), share=EffectParameter("", 0.08, 0.03, 0.2))
def chamber_crosstalk(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Apply a ``share`` of the pressure to the chamber of the other segment, or on the next one.

    Pressure of a chamber that also acts in the other segment, at the same azimuth. Without a chamber
    given, the lower chambers act in the upper segment, whose wall their lines run through.
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


@arm_effect(places=("chamber",), change=EffectParameter("", -0.12, -0.3, 0.2))
def chamber_gain(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Scale the effective area by 1 + ``change``.

    A chamber whose pressure is worth more or less than its drawing states.
    """
    gains = list(arm.actuation.gains)
    for chamber in chosen_chambers(arm, where):
        gains[chamber] *= 1.0 + numbers["change"]
    return replace(arm, actuation=replace(arm.actuation, gains=tuple(gains)))


@arm_effect(arm=EffectParameter("m", 5e-4, 1.5e-4, 1.5e-3))
def fibre_twist(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:  # noqa: ARG001
    """Add ``arm``: torque per pressure force of the chambers [m].

    Fibres wound at an angle: pressure twists the arm.
    """
    return replace(arm, actuation=replace(arm.actuation, twist=arm.actuation.twist + numbers["arm"]))


@arm_effect(places=("chamber",), time=EffectParameter("s", 0.3, 0.03, 0.8))
def line_lag(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add ``time`` to the time constant of the line.

    A long or pinched line: the chamber follows its valve late.
    """
    lags = list(arm.actuation.lags)
    for chamber in chosen_chambers(arm, where):
        lags[chamber] += numbers["time"]
    return replace(arm, actuation=replace(arm.actuation, lags=tuple(lags)))


@arm_effect(places=("chamber",), rate=EffectParameter("1/s", 8.0, 3.0, 25.0))
def line_leak(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Lose pressure at ``rate``; in a hold the chamber keeps 1 / (1 + rate lag) of the valve's pressure.

    A chamber that loses air: less pressure than its valve supplies, and decay when the valve is shut.
    """
    rates = list(arm.actuation.leak_rates)
    for chamber in chosen_chambers(arm, where):
        rates[chamber] += numbers["rate"]
    return replace(arm, actuation=replace(arm.actuation, leak_rates=tuple(rates)))
