"""Nearly incompressible hyperelastic elements with an element-mean volume term."""

from dataclasses import dataclass, replace

import numpy as np

from estimator.errors import InputError
from estimator.fem.materials import Material
from estimator.fem.pattern import Pattern, Slots
from estimator.fem.shapes import parent_nodes, quadrature, shape_functions
from estimator.fem.solids_kernel import solid_forces
from estimator.mesh import ElementBlock, Floats, Indices


@dataclass(frozen=True)
class Solids:
    """A block of elements of one kind, ready for the kernel.

    The energy of an element is sum_q w_q psi(I(F_q)) + V U(mean J): the isochoric part at each quadrature
    point q, the volumetric part of the mean volume ratio (mean dilatation; Nagtegaal, Parks and Rice 1974,
    Simo, Taylor and Pister 1985). So no element locks near incompressibility.

    Args:
        kind: Element kind.
        connectivity: Nodes, shape (elements, nodes per element).
        gradients: Gradients of the shape functions at rest [1/m], shape (elements, points, 3, nodes).
        weights: Volume of each quadrature point [m3], shape (elements, points).
        values: Shape functions at the quadrature points, shape (points, nodes).
        coefficients: ``Material.coefficients`` of each element, shape (elements, 5).
        region: Region of each element, shape (elements,).
        slots: Where the blocks of each element go, shape (elements, nodes, nodes).
    """

    kind: str
    connectivity: Indices
    gradients: Floats
    weights: Floats
    values: Floats
    coefficients: Floats
    region: Indices
    slots: Slots

    def attach(self, pattern: Pattern) -> "Solids":
        """Find where the blocks go in a pattern."""
        return replace(self, slots=pattern.locate(self.connectivity))

    def forces(
        self, positions: Floats, scales: Floats, forces: Floats, values: Floats, tangent: bool
    ) -> bool:
        """Add the internal forces and, where wanted, the tangent blocks.

        Args:
            positions: Current nodes [m], shape (nodes, 3).
            scales: Factor on the stiffness of each region, shape (regions,).
            forces: Internal forces [N], added to, shape (nodes, 3).
            values: Tangent blocks [N/m], added to, shape (slots, 3, 3).
            tangent: Whether to add the tangent.

        Returns:
            Whether every element has a positive volume ratio at every point.
        """
        return bool(
            solid_forces(
                positions, self.connectivity, self.gradients, self.weights, self.coefficients,
                scales[self.region], self.slots, forces, values, tangent,
            )
        )  # fmt: skip

    def deformation(self, positions: Floats) -> Floats:
        """Give the deformation gradients, shape (elements, points, 3, 3)."""
        corners = positions[self.connectivity]
        return np.asarray(np.einsum("eqjn,eni->eqij", self.gradients, corners))

    def nodal_mass(self, density: Floats, nodes: int) -> Floats:
        """Integrate the density of each region [kg/m3] against the shape functions [kg], shape (nodes,)."""
        mass = np.einsum("eq,qn->en", self.weights * density[self.region][:, None], self.values)
        return np.bincount(self.connectivity.ravel(), mass.ravel(), minlength=nodes).astype(np.float64)

    def energy_and_stress(self, positions: Floats, scales: Floats) -> tuple[Floats, Floats]:
        """Give strain energy per volume [J/m3] and von Mises stress [Pa], both of shape (elements,)."""
        deformation = self.deformation(positions)
        ratio = np.linalg.det(deformation)
        mean = (self.weights * ratio).sum(axis=1) / self.weights.sum(axis=1)
        left = np.einsum("eqij,eqkj->eqik", deformation, deformation) * ratio[..., None, None] ** (-2.0 / 3.0)
        excess = np.trace(left, axis1=2, axis2=3) - 3.0
        energy, slope = _isochoric(excess, self.coefficients)
        deviator = (
            2.0
            * (slope / ratio)[..., None, None]
            * (left - (excess / 3.0 + 1.0)[..., None, None] * np.eye(3))
        )
        von_mises = np.sqrt(1.5 * np.einsum("eqij,eqij->eq", deviator, deviator))
        share = self.weights / self.weights.sum(axis=1, keepdims=True)
        volumetric = 0.25 * self.coefficients[:, 2] * (mean**2 - 1.0 - 2.0 * np.log(mean))
        scale = scales[self.region]
        return scale * ((share * energy).sum(axis=1) + volumetric), scale * (share * von_mises).sum(axis=1)


def _isochoric(excess: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """Give psi and psi' at I - 3 = ``excess``, both of shape (elements, points)."""
    code, half, _, a, b = (coefficients[:, k, None] for k in range(5))
    with np.errstate(divide="ignore", invalid="ignore"):
        energies = [
            half * excess,
            half * excess * (1.0 + a * excess + b * excess**2),
            -half * a * np.log1p(-excess / a),
            half * (a * excess + (1.0 - a) * np.where(b > 0.0, -np.expm1(-b * excess) / b, excess)),
        ]
        slopes = [
            np.broadcast_to(half, excess.shape),
            half * (1.0 + 2.0 * a * excess + 3.0 * b * excess**2),
            half * a / (a - excess),
            half * (a + (1.0 - a) * np.exp(-b * excess)),
        ]
    masks = [np.broadcast_to(code == k, excess.shape) for k in range(4)]
    return np.select(masks, energies), np.select(masks, slopes)


def build_solids(points: Floats, block: ElementBlock, materials: tuple[Material, ...]) -> Solids:
    """Precompute the geometry of a block at rest.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        block: Elements.
        materials: Material of each region.

    Returns:
        The block, not yet attached to a pattern.

    Raises:
        InputError: An element is inverted or degenerate.
    """
    places, parent_weights = quadrature(block.kind)
    values, slopes = shape_functions(block.kind, places)
    corners = points[block.connectivity]
    jacobian = np.einsum("eni,qnk->eqik", corners, slopes)
    measure = np.linalg.det(jacobian)
    bad = np.flatnonzero(measure.min(axis=1) <= 0.0)
    if len(bad):
        where = f"mesh: {block.kind} element {bad[0]}"
        raise InputError(
            where, f"its volume is not positive ({len(bad)} such elements)", "reorder or repair it"
        )
    gradients = np.einsum("qnk,eqkj->eqjn", slopes, np.linalg.inv(jacobian))
    connectivity = np.array(block.connectivity, dtype=np.int64)
    region = np.array(block.region, dtype=np.int64)
    table = np.array([material.coefficients() for material in materials])
    nodes = len(parent_nodes(block.kind))
    return Solids(
        kind=block.kind,
        connectivity=connectivity,
        gradients=np.ascontiguousarray(gradients),
        weights=np.ascontiguousarray(measure * parent_weights),
        values=values,
        coefficients=np.ascontiguousarray(table[region]),
        region=region,
        slots=np.empty((0, nodes, nodes), dtype=np.int32),
    )
