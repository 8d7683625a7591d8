"""Physical effects that may be missing from a model; each is one file of this package."""

from estimator.effects import viscoelastic_creep
from estimator.effects.effect import Effect, Memory, Parameter, Signals, describe
from estimator.effects.world import Spot, World

EFFECTS: dict[str, Effect] = {module.EFFECT.name: module.EFFECT for module in (viscoelastic_creep,)}
"""Every effect by its name in the vocabulary; ``unknown`` has no physics and is not among them."""

__all__ = ["EFFECTS", "Effect", "Memory", "Parameter", "Signals", "Spot", "World", "describe"]
