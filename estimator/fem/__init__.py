"""Finite elements for a soft arm: elements, chambers, fibres, equilibrium, and the model built from them."""

from estimator.fem.background import Refactoriser
from estimator.fem.bars import Membrane, Springs
from estimator.fem.equilibrium import Settings
from estimator.fem.loads import DistributedLoad
from estimator.fem.materials import Material
from estimator.fem.model import FiniteElementModel, FiniteElementState, FiniteElementStep
from estimator.fem.sections import Section
from estimator.fem.solution import Solution, SolveStatus
from estimator.fem.tracking import TrackingModel, TrackingState, TrackingStep, predict_state

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
