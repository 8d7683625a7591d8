"""Steps that bend the body instead of stretching it: rotation-strain coordinates (Huang et al. 2011).

An arm is soft to bend and stiff to stretch, by orders of magnitude. A displacement that bends it at one
configuration stretches it at another that is rotated by a fraction of a degree, and a straight step along it
stretches it too. Both are avoided by acting on displacement gradients, which rotate with the material, in
place of displacements: the rotated gradients A are put together again by the field v that fits them best,

    min over v of sum_q w_q |grad v - A_q|^2,

a Poisson problem whose matrix never changes. This is the plain path in double precision; ``tracking`` has the
same operations in single precision, eight elements at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.linalg.small import polar_rotations
from softarm.estimator.mesh import ElementBlock
from softarm.estimator.rotations import exp
from softarm.estimator.shape_functions import quadrature, shape_functions

REGULARISATION = 1e-12
"""Share of the Poisson matrix's diagonal that is added to it."""


@dataclass(frozen=True)
class QuadraturePoints:
    """The quadrature points of one block of elements.

    Args:
        connectivity: Nodes, shape (elements, nodes).
        gradients: Gradients of the shape functions at rest [1/m], shape (elements, points, nodes, 3).
        weights: Volume of each point [m3], shape (elements, points).
    """

    connectivity: Indices
    gradients: Floats
    weights: Floats

    @classmethod
    def of(cls, points: Floats, block: ElementBlock) -> "QuadraturePoints":
        """Evaluate a block at rest; ``points`` are the nodes [m], shape (nodes, 3)."""
        places, parent_weights = quadrature(block.kind)
        slopes = shape_functions(block.kind, places)[1]
        jacobian = np.einsum("eni,qnk->eqik", points[block.connectivity], slopes)
        gradients = np.einsum("qnk,eqkj->eqnj", slopes, np.linalg.inv(jacobian))
        return cls(block.connectivity, gradients, np.linalg.det(jacobian) * parent_weights)

    def laplacian(self) -> Floats:
        """Integrate grad N_a . grad N_b over each element [m], shape (elements, nodes, nodes)."""
        scaled = self.gradients * np.sqrt(self.weights)[..., None, None]
        return np.asarray(np.einsum("eqaj,eqbj->eab", scaled, scaled, optimize=True))


@dataclass(frozen=True)
class RotationStrain:
    """Carries displacements between configurations of a body.

    Fields of matrices at all quadrature points have shape (points, 3, 3).

    Args:
        blocks: Quadrature points of the blocks of elements.
        nodes: Number of nodes.
        free: Nodes that nothing holds, shape (free,).
        poisson: Poisson matrix over them.
    """

    blocks: tuple[QuadraturePoints, ...]
    nodes: int
    free: Indices
    poisson: sparse.csc_matrix

    @classmethod
    def of(cls, points: Floats, blocks: Sequence[ElementBlock], free: Indices) -> "RotationStrain":
        """Evaluate the elements at rest and factor the Poisson matrix."""
        evaluated = tuple(QuadraturePoints.of(points, block) for block in blocks)
        rows = [np.repeat(b.connectivity, b.connectivity.shape[1], axis=1).ravel() for b in evaluated]
        columns = [np.tile(b.connectivity, b.connectivity.shape[1]).ravel() for b in evaluated]
        values = np.concatenate([b.laplacian().ravel() for b in evaluated])
        shape = (len(points), len(points))
        entries = (values, (np.concatenate(rows), np.concatenate(columns)))
        matrix = sparse.csc_matrix(entries, shape=shape)[free][:, free]
        # Without a held node a constant field costs nothing; this keeps it from being arbitrary.
        matrix += sparse.diags(REGULARISATION * matrix.diagonal())
        return cls(evaluated, len(points), free, matrix.tocsc())

    @cached_property
    def factor(self) -> SuperLU:
        """Factor of the Poisson matrix."""
        return splu(self.poisson)

    def __getstate__(self) -> dict[str, Any]:
        # SuperLU's factor cannot be sent to another process; it is made again there.
        return {name: value for name, value in self.__dict__.items() if name != "factor"}

    def gradient(self, nodal: Floats) -> Floats:
        """Differentiate a nodal field, shape (nodes, 3), by the rest positions."""
        fields = [nodal[b.connectivity].transpose(0, 2, 1)[:, None] @ b.gradients for b in self.blocks]
        return np.concatenate([field.reshape(-1, 3, 3) for field in fields])

    def deformation(self, displacement: Floats) -> Floats:
        """Compute the deformation gradients of a displacement."""
        return self.gradient(displacement) + np.eye(3)

    def divergence(self, fields: Floats) -> Floats:
        """Apply the adjoint of ``gradient`` under the volumes, to shape (nodes, 3)."""
        nodal, start = np.zeros((self.nodes, 3)), 0
        for block in self.blocks:
            count = block.weights.size
            part = fields[start : start + count].reshape(*block.weights.shape, 3, 3)
            weighted = block.weights[..., None, None] * part
            np.add.at(nodal, block.connectivity, (block.gradients @ weighted.swapaxes(2, 3)).sum(axis=1))
            start += count
        return nodal

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Solve the Poisson problem for nodal values, shape (nodes, columns), zero where held."""
        solution = np.zeros_like(nodal)
        solution[self.free] = self.factor.solve(nodal[self.free])
        return solution

    def rotations(self, before: Floats, after: Floats) -> Floats:
        """Compute the rotation at every point between configurations with given deformation gradients."""
        return polar_rotations(after @ np.linalg.inv(before))

    def corotated_divergence(self, rotations: Floats, nodal: Floats) -> Floats:
        """Compute the divergence of the gradient of a displacement carried along, shape (nodes, 3)."""
        return self.divergence(rotations @ self.gradient(nodal))

    def pulled_back(self, rotations: Floats, forces: Floats) -> Floats:
        """Carry nodal forces back, the adjoint of carrying a displacement, shape (nodes, 3)."""
        return self.divergence(rotations.swapaxes(1, 2) @ self.gradient(self.solve_poisson(forces)))

    def moved(
        self, displacement: Floats, deformation: Floats, step: Floats, rotations: Floats | None = None
    ) -> Floats:
        """Move by a linear step, its spin taken as a finite rotation: F becomes exp(spin) (1 + strain) F.

        Args:
            displacement: Displacement before [m], shape (nodes, 3).
            deformation: Its deformation gradients F.
            step: Linear step [m], shape (nodes, 3).
            rotations: Rotations since the configuration that it is a step of, along which it is carried; none
                when left out.

        Returns:
            The displacement after [m], shape (nodes, 3).
        """
        gradient = self.gradient(step)
        if rotations is not None:
            gradient = rotations @ gradient
        velocity = gradient @ np.linalg.inv(deformation)
        skew = 0.5 * (velocity - velocity.swapaxes(1, 2))
        # The axial vector of the skew part.
        spin = exp(np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]]))
        strained = np.eye(3) + 0.5 * (velocity + velocity.swapaxes(1, 2))
        change = (spin @ strained - np.eye(3)) @ deformation
        return displacement + self.solve_poisson(self.divergence(change))
