"""Co-rotational linear tetrahedra, with the exact derivative of their rotation."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.fem.elements.material import FRAME_CODES, Material
from softarm.estimator.fem.linalg.pattern import Pattern, Slots
from softarm.estimator.fem.parity.corotational_kernel import tetrahedron_forces, tetrahedron_rotations
from softarm.estimator.mesh import ElementBlock

SMALL, POLAR = FRAME_CODES["small"], FRAME_CODES["corotational_polar"]
EDGE_POLAR = FRAME_CODES["corotational_edge_polar"]


@dataclass(frozen=True)
class Tetrahedra:
    """Linear tetrahedra whose strain is measured in a frame that follows them.

    Args:
        connectivity: Nodes, shape (elements, 4).
        rest: Rest positions of the corners less that of the first [m], shape (elements, 4, 3).
        stiffness: Linear stiffness for a unit scale [N/m], shape (elements, 12, 12).
        frame: Rule of the frame: 0 none, 1 first three nodes, 2 or 3 polar, shape (elements,).
        fit: Coefficients c of the matrix sum_a x_a c_a^T that the polar rules take, shape (elements, 4, 3).
        rest_frame: Frame at rest, shape (elements, 3, 3).
        volume: Rest volume [m3], shape (elements,).
        region: Region of each element, shape (elements,).
        slots: Where the blocks of each element go, shape (elements, 4, 4).
    """

    connectivity: Indices
    rest: Floats
    stiffness: Floats
    frame: Indices
    fit: Floats
    rest_frame: Floats
    volume: Floats
    region: Indices
    slots: Slots

    @property
    def symmetric(self) -> bool:
        """Whether the forces derive from an energy, so that the tangent is symmetric."""
        return bool(np.isin(self.frame, (SMALL, POLAR)).all())

    def attach(self, pattern: Pattern) -> "Tetrahedra":
        """Find where the blocks go in a pattern."""
        return replace(self, slots=pattern.locate(self.connectivity))

    def forces(
        self, positions: Floats, scales: Floats, forces: Floats, values: Floats, mirror: Floats, tangent: bool
    ) -> bool:
        """Add the internal forces and, where wanted, the exact tangent; see ``Solids.forces``."""
        return bool(
            tetrahedron_forces(
                positions, self.connectivity, self.rest, self.stiffness, self.frame, self.fit,
                self.rest_frame, scales[self.region], self.slots, forces, values, mirror, tangent,
            )
        )  # fmt: skip

    def nodal_mass(self, density: Floats, nodes: int) -> Floats:
        """Share the mass of each element among its corners [kg], shape (nodes,)."""
        share = np.repeat(0.25 * self.volume * density[self.region], 4)
        return np.bincount(self.connectivity.ravel(), share, minlength=nodes).astype(np.float64)

    def energy_and_stress(self, positions: Floats, scales: Floats) -> tuple[Floats, Floats]:
        """Compute strain energy per volume [J/m3] and von Mises stress [Pa], both of shape (elements,)."""
        rotation = tetrahedron_rotations(positions, self.connectivity, self.frame, self.fit, self.rest_frame)
        corners = positions[self.connectivity]
        local = np.einsum("eji,enj->eni", rotation, corners - corners[:, :1]) - self.rest
        strain_forces = np.einsum("eab,eb->ea", self.stiffness, local.reshape(-1, 12)).reshape(-1, 4, 3)
        scale = scales[self.region] / self.volume
        energy = 0.5 * scale * np.einsum("eni,eni->e", strain_forces, local)
        stress = scale[:, None, None] * np.einsum("eni,enj->eij", strain_forces, self.rest)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        return energy, np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator))


def build_tetrahedra(points: Floats, block: ElementBlock, materials: tuple[Material, ...]) -> Tetrahedra:
    """Precompute the linear stiffness and the rest frames.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        block: Elements of kind ``tet4``.
        materials: Co-rotational material of each region.

    Returns:
        The elements, not yet attached to a pattern.

    Raises:
        InputError: The elements are not linear tetrahedra, or one is inverted.
    """
    if block.kind != "tet4":
        raise InputError(
            "material", f"a co-rotational law on {block.kind} elements", "use tet4 or a hyperelastic law"
        )
    corners = points[block.connectivity]
    rest = np.ascontiguousarray(corners - corners[:, :1])
    edges = rest[:, 1:].transpose(0, 2, 1)
    volume = np.linalg.det(edges) / 6.0
    bad = np.flatnonzero(volume <= 0.0)
    if len(bad):
        raise InputError(
            f"mesh: tet4 element {bad[0]}", "its volume is not positive", "swap two of its nodes"
        )
    inverse = np.linalg.inv(edges)
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    region = np.array(block.region, dtype=np.int64)
    frame = np.array([FRAME_CODES[material.law] for material in materials])[region]
    unit_edges = np.vstack([-np.ones(3), np.eye(3)])
    fit = np.where((frame == EDGE_POLAR)[:, None, None], unit_edges, gradients)
    connectivity = np.array(block.connectivity, dtype=np.int64)
    identity = np.tile(np.eye(3), (len(region), 1, 1))
    positions = np.array(points, dtype=float)
    rest_frame = tetrahedron_rotations(positions, connectivity, frame, np.ascontiguousarray(fit), identity)
    return Tetrahedra(
        connectivity=connectivity,
        rest=rest,
        stiffness=_linear_stiffness(gradients, volume, [materials[k] for k in region]),
        frame=frame,
        fit=np.ascontiguousarray(fit),
        rest_frame=rest_frame,
        volume=volume,
        region=region,
        slots=np.empty((0, 4, 4), dtype=np.int32),
    )


def _linear_stiffness(gradients: Floats, volume: Floats, materials: list[Material]) -> Floats:
    """Integrate lambda g_a g_b^T + mu (g_b g_a^T + g_a.g_b 1) over each element, shape (elements, 12, 12)."""
    shear = np.array([material.shear_modulus for material in materials]) * volume
    lame = np.array([material.bulk_modulus for material in materials]) * volume - 2.0 / 3.0 * shear
    products = np.einsum("eai,ebk->eaibk", gradients, gradients)
    dots = np.einsum("eai,ebi->eab", gradients, gradients)
    blocks = lame[:, None, None, None, None] * products + shear[:, None, None, None, None] * (
        products.transpose(0, 1, 4, 3, 2) + np.einsum("eab,ik->eaibk", dots, np.eye(3))
    )
    return np.ascontiguousarray(blocks.reshape(-1, 12, 12))
