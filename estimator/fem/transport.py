"""Displacements carried along with the material, so that what was small strain stays small strain.

An arm is soft to bend and stiff to stretch, by orders of magnitude. A displacement that bends it at one
configuration stretches it at another that is turned by a fraction of a degree, and a straight step along it
stretches it too. Both are cured by acting on displacement gradients, which turn with the material, in place
of displacements: the turned gradients A are put together again by the field v that fits them best,

    min over v of sum_q w_q |grad v - A_q|^2,

a Poisson problem whose matrix never changes (rotation-strain coordinates, Huang et al. 2011).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.fem.dissection import Dissection
from estimator.fem.factor import FactorPlan
from estimator.fem.fronts import analyse
from estimator.fem.pattern import Pattern, Tangent
from estimator.fem.shapes import quadrature, shape_functions
from estimator.fem.substitution import CompactFactor
from estimator.fem.transport_kernel import (
    carry_gradients,
    point_divergence,
    point_gradients,
    turns_between,
    wind_gradients,
)
from estimator.mesh import ElementBlock, Floats, Indices

UNHELD = 1e-12
"""Share of the Poisson matrix's diagonal that is added to it."""


@dataclass(frozen=True)
class Patch:
    """The quadrature points of one block of elements.

    Args:
        connectivity: Nodes, shape (elements, nodes).
        gradients: Gradients of the shape functions at rest [1/m], shape (elements, points, nodes, 3).
        weights: Volume of each point [m3], shape (elements, points).
        span: Where its points stand among all points.
    """

    connectivity: Indices
    gradients: Floats
    weights: Floats
    span: slice


@dataclass(frozen=True)
class Transport:
    """Carries displacements between configurations. Fields have shape (points, 3, 3), over all blocks.

    Args:
        patches: Quadrature points of the blocks.
        points: Number of quadrature points.
        pattern: Free nodes.
        factor: Factor of the Poisson matrix, one dof per free node. What single precision leaves out of a
            field is out of balance at the next residual.
    """

    patches: tuple[Patch, ...]
    points: int
    pattern: Pattern
    factor: CompactFactor

    def gradient(self, nodal: Floats) -> Floats:
        """Differentiate a nodal field by the rest positions, shape (nodes, 3) to (points, 3, 3)."""
        fields = np.empty((self.points, 3, 3))
        for patch in self.patches:
            point_gradients(nodal, patch.connectivity, patch.gradients, fields[patch.span])
        return fields

    def deformation(self, displacement: Floats) -> Floats:
        """Give the deformation gradient of a displacement, shape (points, 3, 3)."""
        return self.gradient(displacement) + np.eye(3)

    def divergence(self, fields: Floats) -> Floats:
        """Apply the adjoint of ``gradient`` under the volumes, shape (points, 3, 3) to (nodes, 3)."""
        nodal = np.zeros((len(self.pattern.place), 3))
        for patch in self.patches:
            point_divergence(fields[patch.span], patch.connectivity, patch.gradients, patch.weights, nodal)
        return nodal

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Solve the Poisson problem for scalar fields, shape (fields, nodes), zero where held."""
        free = self.pattern.free_nodes
        solved = np.zeros_like(nodal)
        solved[:, free] = self.factor.solve(nodal[:, free])
        return solved

    def _solve(self, nodal: Floats) -> Floats:
        """Solve the Poisson problem for each component, shape (nodes, 3), zero where held."""
        return np.ascontiguousarray(self.solve_poisson(nodal.T).T)

    def assemble(self, fields: Floats) -> Floats:
        """Find the displacement whose gradient fits fields best, zero where held, shape (nodes, 3)."""
        return self._solve(self.divergence(fields))

    def turns(self, inverse_before: Floats, after: Floats) -> Floats:
        """Give the rotation at every point from a configuration, by its inverse F, to another, by its F."""
        turns = np.empty((self.points, 3, 3))
        turns_between(inverse_before, after, turns)
        return turns

    def carried(self, turns: Floats, nodal: Floats) -> Floats:
        """Give the divergence of the gradient of a displacement carried along the turns, shape (nodes, 3)."""
        return self._carry(turns, nodal, back=False)

    def forces_back(self, turns: Floats, forces: Floats) -> Floats:
        """Carry nodal forces back, the adjoint of carrying a displacement, shape (nodes, 3)."""
        return self._carry(turns, self._solve(forces), back=True)

    def _carry(self, turns: Floats, nodal: Floats, *, back: bool) -> Floats:
        carried = np.zeros_like(nodal)
        for patch in self.patches:
            carry_gradients(
                nodal, patch.connectivity, patch.gradients, patch.weights, turns[patch.span], back, carried
            )
        return carried

    def moved(
        self, displacement: Floats, deformation: Floats, step: Floats, turns: Floats | None = None
    ) -> Floats:
        """Move by a linear step, its spin taken as a finite rotation.

        Args:
            displacement: Displacement before [m], shape (nodes, 3).
            deformation: Its deformation gradient, shape (points, 3, 3).
            step: Linear step [m], shape (nodes, 3).
            turns: Rotations since the configuration that it is a step of, along which it is carried, shape
                (points, 3, 3); none when left out.

        Returns:
            The displacement after [m], shape (nodes, 3).
        """
        turns = np.tile(np.eye(3), (self.points, 1, 1)) if turns is None else turns
        divergence = np.zeros_like(step)
        for patch in self.patches:
            wind_gradients(
                step, patch.connectivity, patch.gradients, patch.weights, turns[patch.span],
                deformation[patch.span], divergence,
            )  # fmt: skip
        return displacement + self._solve(divergence)


def build_transport(
    points: Floats, blocks: Sequence[ElementBlock], pattern: Pattern, dissection: Dissection
) -> Transport:
    """Prepare the points and factor the Poisson matrix."""
    patches, start = [], 0
    values = np.zeros((pattern.slots, 1, 1))
    for block in blocks:
        places, parent_weights = quadrature(block.kind)
        slopes = shape_functions(block.kind, places)[1]
        jacobian = np.einsum("eni,qnk->eqik", points[block.connectivity], slopes)
        gradients = np.ascontiguousarray(np.einsum("qnk,eqkj->eqnj", slopes, np.linalg.inv(jacobian)))
        weights = np.linalg.det(jacobian) * parent_weights
        end = start + weights.size
        patches.append(Patch(np.array(block.connectivity), gradients, weights, slice(start, end)))
        start = end
        local = np.einsum("eq,eqaj,eqbj->eab", weights, gradients, gradients)
        slots = pattern.locate(block.connectivity)
        np.add.at(values[:, 0, 0], slots[slots >= 0], local[slots >= 0])
    # Without a held node a constant field costs nothing; this keeps it from being arbitrary.
    values[pattern.column_start[:-1]] *= 1.0 + UNHELD
    plan = FactorPlan.of(pattern, analyse(pattern, dissection, size=1))
    factor = plan.factorise(Tangent(values, values))
    if factor is None:
        raise ValueError("the Poisson matrix of a clamped body is positive definite")
    return Transport(tuple(patches), start, pattern, factor.compact())
