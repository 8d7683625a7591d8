"""Finite elements for a soft arm: elements, chambers, fibres, equilibrium, and the model built from them."""

from estimator.fem.bars import Membrane, Springs
from estimator.fem.equilibrium import Settings
from estimator.fem.loads import DistributedLoad
from estimator.fem.materials import Material
from estimator.fem.model import FiniteElementModel, FiniteElementState, FiniteElementStep
from estimator.fem.sections import Section
from estimator.fem.solution import Solution, SolveStatus

__all__ = [
    "DistributedLoad",
    "FiniteElementModel",
    "FiniteElementState",
    "FiniteElementStep",
    "Material",
    "Membrane",
    "Section",
    "Settings",
    "Solution",
    "SolveStatus",
    "Springs",
]
