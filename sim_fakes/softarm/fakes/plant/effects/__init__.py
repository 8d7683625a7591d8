"""Concealed effects: what an arm, its valves and its sensors do that no model was told.

Those of ``arm`` and ``instrument`` are the diagnosis's vocabulary, those of ``foreign`` lie outside it.
"""

from softarm.fakes.plant.effects.effect import (
    ArmEffect,
    Concealed,
    ConcealedEffect,
    EffectParameter,
    Filter,
    InstrumentEffect,
)
from softarm.fakes.plant.effects.registry import (
    ARM_EFFECTS,
    FOREIGN_EFFECTS,
    INSTRUMENT_EFFECTS,
    apply,
    arm_effects,
    effect,
    filters,
)

__all__ = [
    "ARM_EFFECTS",
    "FOREIGN_EFFECTS",
    "INSTRUMENT_EFFECTS",
    "ArmEffect",
    "Concealed",
    "ConcealedEffect",
    "EffectParameter",
    "Filter",
    "InstrumentEffect",
    "apply",
    "arm_effects",
    "effect",
    "filters",
]
