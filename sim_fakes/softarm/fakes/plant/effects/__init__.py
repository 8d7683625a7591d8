"""Concealed effects: what an arm, its valves and its sensors do that no model contains.

Those of ``arm`` and ``instrument`` are the diagnosis's vocabulary, those of ``foreign`` lie outside it.
"""

from softarm.fakes.plant.effects.effect import (
    Concealed,
    ConcealedEffect,
    EffectParameter,
    Filter,
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
    "Concealed",
    "ConcealedEffect",
    "EffectParameter",
    "Filter",
    "apply",
    "arm_effects",
    "effect",
    "filters",
]
