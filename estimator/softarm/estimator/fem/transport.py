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

from softarm.estimator.fem.dissection import Dissection
from softarm.estimator.fem.factor import FactorPlan
from softarm.estimator.fem.fronts import analyse
from softarm.estimator.fem.lanes import SINGLE_LANES
from softarm.estimator.fem.pattern import Pattern, Tangent
from softarm.estimator.fem.shapes import quadrature, shape_functions
from softarm.estimator.fem.substitution import CompactFactor
from softarm.estimator.fem.transport_kernel import (
    carry_gradients,
    invert_fields,
    point_divergence,
    point_gradients,
    turns_between,
    wind_gradients,
)
from softarm.estimator.mesh import ElementBlock, Floats, Indices, Singles

UNHELD = 1e-12
"""Share of the Poisson matrix's diagonal that is added to it."""


@dataclass(frozen=True)
class Patch:
    """The quadrature points of one block of elements, in groups of ``SINGLE_LANES`` elements.

    Args:
        connectivity: Nodes, -1 - n where an element only fills up the last group, shape (batches, lanes,
            nodes).
        gradients: Gradients of the shape functions at rest [1/m], shape (batches, points, nodes, 3, lanes).
        weights: Volume of each point [m3], shape (batches, points, lanes).
        span: Where its groups of points stand among all.
    """

    connectivity: Indices
    gradients: Singles
    weights: Singles
    span: slice


@dataclass(frozen=True)
class Transport:
    """Carries displacements between configurations.

    Fields of matrices at the quadrature points have shape (groups, 9, lanes), over all blocks.

    Args:
        patches: Quadrature points of the blocks.
        groups: Number of groups of quadrature points.
        pattern: Free nodes.
        factor: Factor of the Poisson matrix, one dof per free node. What single precision leaves out of a
            field is out of balance at the next residual.
    """

    patches: tuple[Patch, ...]
    groups: int
    pattern: Pattern
    factor: CompactFactor

    def _field(self) -> Singles:
        return np.empty((self.groups, 9, SINGLE_LANES), dtype=np.float32)

    def gradient(self, nodal: Floats, diagonal: float = 0.0) -> Singles:
        """Differentiate a nodal field, shape (nodes, 3), by the rest positions; add to the diagonals."""
        fields = self._field()
        for patch in self.patches:
            point_gradients(nodal, patch.connectivity, patch.gradients, diagonal, fields[patch.span])
        return fields

    def deformation(self, displacement: Floats) -> Singles:
        """Give the deformation gradient of a displacement."""
        return self.gradient(displacement, 1.0)

    def inverse(self, fields: Singles) -> Singles:
        """Invert every matrix of a field."""
        inverse = self._field()
        invert_fields(fields, inverse)
        return inverse

    def divergence(self, fields: Singles) -> Floats:
        """Apply the adjoint of ``gradient`` under the volumes, to shape (nodes, 3)."""
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

    def _solve(self, nodal: Floats, start: Floats) -> Floats:
        """Solve the Poisson problem for each component and add it, both of shape (nodes, 3)."""
        solved = start.copy()
        self.factor.add_vectors(nodal, self.pattern.free_nodes, solved)
        return solved

    def assemble(self, fields: Singles) -> Floats:
        """Find the displacement whose gradient fits fields best, zero where held, shape (nodes, 3)."""
        divergence = self.divergence(fields)
        return self._solve(divergence, np.zeros_like(divergence))

    def turns(self, inverse_before: Singles, after: Singles) -> Singles:
        """Give the rotation at every point from a configuration, by its inverse F, to another, by its F."""
        turns = self._field()
        turns_between(inverse_before, after, turns)
        return turns

    def carried(self, turns: Singles, nodal: Floats) -> Floats:
        """Give the divergence of the gradient of a displacement carried along the turns, shape (nodes, 3)."""
        return self._carry(turns, nodal, back=False)

    def forces_back(self, turns: Singles, forces: Floats) -> Floats:
        """Carry nodal forces back, the adjoint of carrying a displacement, shape (nodes, 3)."""
        return self._carry(turns, self._solve(forces, np.zeros_like(forces)), back=True)

    def _carry(self, turns: Singles, nodal: Floats, *, back: bool) -> Floats:
        carried = np.zeros_like(nodal)
        for patch in self.patches:
            carry_gradients(
                nodal, patch.connectivity, patch.gradients, patch.weights, turns[patch.span], back, carried
            )
        return carried

    def moved(
        self, displacement: Floats, deformation: Singles, step: Floats, turns: Singles | None = None
    ) -> Floats:
        """Move by a linear step, its spin taken as a finite rotation.

        Args:
            displacement: Displacement before [m], shape (nodes, 3).
            deformation: Its deformation gradient.
            step: Linear step [m], shape (nodes, 3).
            turns: Rotations since the configuration that it is a step of, along which it is carried; none
                when left out.

        Returns:
            The displacement after [m], shape (nodes, 3).
        """
        if turns is None:
            turns = self.gradient(np.zeros_like(step), 1.0)
        divergence = np.zeros_like(step)
        for patch in self.patches:
            wind_gradients(
                step, patch.connectivity, patch.gradients, patch.weights, turns[patch.span],
                deformation[patch.span], divergence,
            )  # fmt: skip
        return self._solve(divergence, displacement)


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
        gradients = np.einsum("qnk,eqkj->eqnj", slopes, np.linalg.inv(jacobian))
        weights = np.linalg.det(jacobian) * parent_weights
        patches.append(_patch(block.connectivity, gradients, weights, start))
        start = patches[-1].span.stop
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


def _patch(connectivity: Indices, gradients: Floats, weights: Floats, start: int) -> Patch:
    """Group elements by lanes, the groups of their points standing from ``start`` on."""
    count = len(connectivity)
    element = np.minimum(np.arange(-(-count // SINGLE_LANES) * SINGLE_LANES), count - 1)
    padding = np.arange(len(element)) >= count
    nodes = np.where(padding[:, None], -1 - connectivity[element], connectivity[element]).astype(np.int64)

    def grouped(values: Floats) -> Singles:
        """Move the lanes last, shape (elements, ...) to (batches, ..., lanes)."""
        lanes_second = values[element].reshape(-1, SINGLE_LANES, *values.shape[1:])
        return np.ascontiguousarray(np.moveaxis(lanes_second, 1, -1), dtype=np.float32)

    batches = len(element) // SINGLE_LANES
    return Patch(
        connectivity=np.ascontiguousarray(nodes.reshape(batches, SINGLE_LANES, -1)),
        gradients=grouped(gradients),
        weights=grouped(weights),
        span=slice(start, start + batches * weights.shape[1]),
    )
