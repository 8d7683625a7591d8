"""Physical effects that may be missing from a model; each is one file of this package."""

from importlib import import_module
from pkgutil import iter_modules
from typing import get_args

from softarm.estimator.effects.effect import Effect, ParameterSpec, describe
from softarm.estimator.effects.world import Spot, World
from softarm.estimator.specimen.physics import EffectName

# Adding an effect is its file here and its name in the vocabulary; names without a file have no physics.
_FILES = sorted({module.name for module in iter_modules(__path__)} & set(get_args(EffectName)))

EFFECTS: dict[str, Effect] = {name: import_module(f"{__name__}.{name}").EFFECT for name in _FILES}
"""Every effect by its name in the vocabulary."""

__all__ = [
    "EFFECTS",
    "Effect",
    "ParameterSpec",
    "Spot",
    "World",
    "describe",
]
