"""Finite elements for a soft arm: elements, chambers, fibres, equilibrium, and the model built from them."""

from softarm.estimator.fem.background import Refactoriser
from softarm.estimator.fem.bars import Membrane, Springs
from softarm.estimator.fem.equilibrium import Settings
from softarm.estimator.fem.loads import DistributedLoad
from softarm.estimator.fem.materials import Material
from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState, FiniteElementStep
from softarm.estimator.fem.sections import Section
from softarm.estimator.fem.solution import Solution, SolveStatus
from softarm.estimator.fem.tracking import TrackingModel, TrackingState, TrackingStep, predict_state

__all__ = [
    "DistributedLoad",
    "FiniteElementModel",
    "FiniteElementState",
    "FiniteElementStep",
    "Material",
    "Membrane",
    "Refactoriser",
    "Section",
    "Settings",
    "Solution",
    "SolveStatus",
    "Springs",
    "TrackingModel",
    "TrackingState",
    "TrackingStep",
    "predict_state",
]
