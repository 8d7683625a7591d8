"""Creep: Maxwell branches beside the rubber, one, three, or a spectrum that is flat over decades."""

from dataclasses import replace

import numpy as np

from softarm.fakes.plant.effects.effect import ArmEffect, EffectParameter, Numbers, Where
from softarm.fakes.plant.effects.places import change_memory
from softarm.fakes.plant.parameters import ArmParameters, Memory


def change(arm: ArmParameters, where: Where, numbers: Numbers) -> ArmParameters:
    """Add branches of total strength ``strength``, spread over ``decades`` around ``time``."""
    branches = max(1, round(2.0 * numbers["decades"]) + 1)
    exponents = np.linspace(-0.5, 0.5, branches) * numbers["decades"]
    times = tuple(float(t) for t in numbers["time"] * 10.0**exponents)
    strengths = (numbers["strength"] / branches,) * branches

    def creep(memory: Memory) -> Memory:
        return replace(memory, relaxation=memory.relaxation + strengths, times=memory.times + times)

    return change_memory(arm, where, creep)


EFFECT = ArmEffect(
    "viscoelastic_creep",
    "strength",
    {
        "strength": EffectParameter("", 0.15, 0.03, 0.30),
        "time": EffectParameter("s", 8.0, 3.0, 20.0),
        "decades": EffectParameter("", 0.0, 0.0, 2.0),
    },
    ("segment",),
    change=change,
)
