"""Physical effects that may be missing from a model, in modules by where in the arm they act."""

from softarm.estimator.effects import chambers, hysteresis, rubber, sensors, surroundings, valves
from softarm.estimator.effects.effect import Effect, ParameterSpec, describe
from softarm.estimator.effects.world import Spot, World

_FOUND = (
    one
    for module in (chambers, hysteresis, rubber, sensors, surroundings, valves)
    for one in vars(module).values()
    if isinstance(one, Effect)
)
EFFECTS: dict[str, Effect] = {one.name: one for one in sorted(_FOUND, key=lambda one: one.name)}
"""Every effect by its name in the vocabulary; names without one have no physics."""

__all__ = ["EFFECTS", "Effect", "ParameterSpec", "Spot", "World", "describe"]
