"""Finite elements for a soft arm: elements, chambers, fibres, equilibrium, and the model built from them.

``softarm.estimator.fem.tracking``, which follows an arm in real time, is imported on its own.
"""

from softarm.estimator.fem.elements.fibre import Membrane
from softarm.estimator.fem.elements.material import Material
from softarm.estimator.fem.loads import DistributedLoad
from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.parity.springs import Springs
from softarm.estimator.fem.sections import SectionNodes
from softarm.estimator.fem.statics.equilibrium import Settings
from softarm.estimator.fem.statics.solution import SolveStatus

__all__ = [
    "DistributedLoad",
    "FiniteElementModel",
    "FiniteElementState",
    "Material",
    "Membrane",
    "SectionNodes",
    "Settings",
    "SolveStatus",
    "Springs",
]
