"""Hysteresis that no slowness removes: elastic-slip elements, smooth (Bouc-Wen) or three stops in a row."""

from dataclasses import replace

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_memory
from softarm.fakes.plant.parameters import ArmParameters, Memory

SPREAD = (0.4, 1.0, 2.5)


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add elements of total strength ``strength`` that slip about the strain ``width``."""
    spread = SPREAD if numbers["sharpness"] >= 20.0 else (1.0,)
    strengths = (numbers["strength"] / len(spread),) * len(spread)
    widths = tuple(numbers["width"] * share for share in spread)

    def slip(memory: Memory) -> Memory:
        if numbers["strength"] == 0.0:
            return memory
        return replace(
            memory,
            hysteresis=memory.hysteresis + strengths,
            widths=memory.widths + widths,
            sharpness=numbers["sharpness"],
        )

    return change_memory(arm, where, slip)


EFFECT = ArmEffect(
    "hysteresis",
    "strength",
    {
        "strength": EffectParameter("", 0.30, 0.06, 0.60),
        "width": EffectParameter("", 0.03, 0.015, 0.05),
        "sharpness": EffectParameter("", 30.0, 2.0, 30.0),
    },
    ("segment",),
    change=change,
)
