"""The calibrated rod: a chain of links whose laws were fitted to the finite-element model."""

from softarm.estimator.rod.archive import shape_key
from softarm.estimator.rod.fit import FittedRod, Recipe, adapted, sampled_model
from softarm.estimator.rod.held_out import HeldOut, HeldOutReport, check_rod
from softarm.estimator.rod.model import CalibratedRod

__all__ = [
    "CalibratedRod",
    "FittedRod",
    "HeldOut",
    "HeldOutReport",
    "Recipe",
    "adapted",
    "check_rod",
    "sampled_model",
    "shape_key",
]
