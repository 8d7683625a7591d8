"""Rotation-strain coordinates in single precision, eight elements at a time.

The operations are those of ``softarm.estimator.fem.rotation_strain``, which states what they are for. What
single precision leaves out of a step is out of balance at the next residual, which is in double precision.
"""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.assembly import Body
from softarm.estimator.fem.linalg.cholesky import CholeskyPlan
from softarm.estimator.fem.linalg.pattern import Pattern
from softarm.estimator.fem.linalg.simd import simd_axis_last, simd_groups
from softarm.estimator.fem.linalg.symbolic import analyse
from softarm.estimator.fem.rotation_strain import REGULARISATION, QuadraturePoints
from softarm.estimator.fem.tracking.rotation_strain_kernel import (
    SINGLE_SIMD_WIDTH,
    corotated_divergence,
    finite_rotation_divergence,
    point_gradients,
    rotations_between,
)
from softarm.estimator.fem.tracking.single_factor import SingleFactor
from softarm.estimator.mesh import Singles


@dataclass(frozen=True)
class PointGroups:
    """The quadrature points of one block of elements, in groups of ``SINGLE_SIMD_WIDTH`` elements.

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
class SingleRotationStrain:
    """Carries displacements between configurations of a body.

    Fields of matrices at the quadrature points have shape (groups, 9, lanes), over all blocks.

    Args:
        blocks: Quadrature points of the blocks.
        groups: Number of groups of quadrature points.
        pattern: Free nodes.
        factor: Factor of the Poisson matrix, one dof per free node.
    """

    blocks: tuple[PointGroups, ...]
    groups: int
    pattern: Pattern
    factor: SingleFactor

    @classmethod
    def of(cls, body: Body) -> "SingleRotationStrain":
        """Group the points of a body and factor its Poisson matrix."""
        pattern, blocks, start = body.pattern, [], 0
        values = np.zeros((pattern.slots, 1, 1))
        for block in body.mesh_blocks:
            points = QuadraturePoints.of(body.points, block)
            blocks.append(_group(points, start))
            start = blocks[-1].span.stop
            slots = pattern.locate(block.connectivity)
            np.add.at(values[:, 0, 0], slots[slots >= 0], points.laplacian()[slots >= 0])
        values[pattern.column_start[:-1]] *= 1.0 + REGULARISATION
        factor = CholeskyPlan.of(analyse(pattern, body.ordering, size=1)).factorise(values)
        if factor is None:
            raise ValueError("the Poisson matrix of a clamped body is positive definite")
        return cls(tuple(blocks), start, pattern, SingleFactor.of(factor))

    def _field(self) -> Singles:
        return np.empty((self.groups, 9, SINGLE_SIMD_WIDTH), dtype=np.float32)

    def deformation(self, displacement: Floats) -> Singles:
        """Compute the deformation gradients of a displacement, shape (nodes, 3)."""
        fields = self._field()
        for block in self.blocks:
            point_gradients(displacement, block.connectivity, block.gradients, 1.0, fields[block.span])
        return fields

    def rotations(self, before: Singles, after: Singles) -> Singles:
        """Compute the rotation at every point between configurations with given deformation gradients."""
        rotations = self._field()
        rotations_between(before, after, rotations)
        return rotations

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Solve the Poisson problem for nodal values, shape (nodes, columns), zero where held."""
        free = self.pattern.free_nodes
        solution = np.zeros_like(nodal)
        solution[free] = self.factor.solve(nodal[free].T).T
        return solution

    def corotated_divergence(self, rotations: Singles, nodal: Floats) -> Floats:
        """Compute the divergence of the gradient of a displacement carried along, shape (nodes, 3)."""
        return self._corotate(rotations, nodal, back=False)

    def pulled_back(self, rotations: Singles, forces: Floats) -> Floats:
        """Carry nodal forces back, the adjoint of carrying a displacement, shape (nodes, 3)."""
        return self._corotate(rotations, self.solve_poisson(forces), back=True)

    def _corotate(self, rotations: Singles, nodal: Floats, *, back: bool) -> Floats:
        carried = np.zeros_like(nodal)
        for block in self.blocks:
            corotated_divergence(
                nodal, block.connectivity, block.gradients, block.weights, rotations[block.span], back,
                carried,
            )  # fmt: skip
        return carried

    def moved(self, displacement: Floats, deformation: Singles, step: Floats, rotations: Singles) -> Floats:
        """Move by a linear step, its spin taken as a finite rotation; see ``RotationStrain.moved``."""
        divergence = np.zeros_like(step)
        for block in self.blocks:
            finite_rotation_divergence(
                step, block.connectivity, block.gradients, block.weights, rotations[block.span],
                deformation[block.span], divergence,
            )  # fmt: skip
        return displacement + self.solve_poisson(divergence)


def _group(points: QuadraturePoints, start: int) -> PointGroups:
    """Group elements by lanes, the groups of their points standing from ``start`` on."""
    element, padding = simd_groups(len(points.connectivity), SINGLE_SIMD_WIDTH)
    # Padding as in `elements.hyperelastic`: copies that compute and add nothing.
    connectivity = points.connectivity[element]
    nodes = np.where(padding[:, None], -1 - connectivity, connectivity).astype(np.int64)

    def grouped(values: Floats) -> Singles:
        return simd_axis_last(values[element], SINGLE_SIMD_WIDTH).astype(np.float32)

    batches = len(element) // SINGLE_SIMD_WIDTH
    return PointGroups(
        connectivity=np.ascontiguousarray(nodes.reshape(batches, SINGLE_SIMD_WIDTH, -1)),
        gradients=grouped(points.gradients),
        weights=grouped(points.weights),
        span=slice(start, start + batches * points.weights.shape[1]),
    )
