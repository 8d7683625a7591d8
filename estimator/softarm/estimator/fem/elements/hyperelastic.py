"""Nearly incompressible hyperelastic elements with an element-mean volume term."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.fem.elements.hyperelastic_kernel import solid_forces
from softarm.estimator.fem.elements.material import Material
from softarm.estimator.fem.linalg.pattern import FIXED, Pattern, Slots
from softarm.estimator.fem.linalg.simd import SIMD_WIDTH, simd_axis_last, simd_groups
from softarm.estimator.mesh import ElementBlock
from softarm.estimator.shape_functions import quadrature, shape_functions

LOCAL_BULK = {"tet4": 0.0, "tet10": 10.0, "hex8": 0.0, "hex20": 10.0}
"""Bulk modulus held at the quadrature points, over the shear modulus."""
HOURGLASS = {"tet4": 0.0, "tet10": 0.0, "hex8": 0.0, "hex20": 0.05}
"""Stiffness of the hourglass modes over shear modulus and edge."""


@dataclass(frozen=True)
class Batches:
    """Elements in groups of ``SIMD_WIDTH``, as ``solid_forces`` reads them.

    Args:
        element: Element of each lane, shape (batches lanes,).
        padding: Whether a lane only fills up the last group, shape (batches lanes,).
        connectivity: Nodes, -1 - n in padding, shape (batches, lanes, nodes).
        gradients: Shape (batches, nodes, points, 3, lanes).
        weights: Shape (batches, points, lanes).
        coefficients: Shape (batches, lanes, 6).
        hourglass: Shape (batches, nodes, nodes, lanes).
        region: Shape (batches, lanes).
        slots: Where the blocks go, shape (batches, nodes, nodes, lanes).
    """

    element: Indices
    padding: NDArray[np.bool_]
    connectivity: Indices
    gradients: Floats
    weights: Floats
    coefficients: Floats
    hourglass: Floats
    region: Indices
    slots: Slots


@dataclass(frozen=True)
class Solids:
    """A block of elements of one kind, ready for the kernel.

    The energy of an element is sum_q w_q [psi(I(F_q)) + P(J_q)] + V U(mean J): the isochoric part at each
    point q, the volumetric part of the mean volume ratio (mean dilatation; Nagtegaal, Parks and
    Rice 1974, Simo, Taylor and Pister 1985), so that no element locks near incompressibility. P takes
    ``LOCAL_BULK`` shear moduli of the bulk modulus: with the mean alone, the volume ratios at the eight
    points of a 20-node hexahedron part without limit, and it is too soft and unstable in large strain.
    Its hourglass modes, which reduced integration leaves without stiffness, get ``HOURGLASS`` shear moduli
    on the part of the nodal positions that no quadratic polynomial of the rest positions explains; that
    part is zero in every homogeneous deformation (after Flanagan and Belytschko 1981).

    Args:
        connectivity: Nodes, shape (elements, nodes per element).
        batches: The same arrays in groups of lanes, as the kernel reads them.
        gradients: Gradients of the shape functions at rest [1/m], shape (elements, nodes, 3, points).
        weights: Volume of each quadrature point [m3], shape (elements, points).
        values: Shape functions at the quadrature points, shape (points, nodes).
        coefficients: Law code, half shear modulus, bulk modulus of the mean, a, b, bulk modulus at the points
            of each element, shape (elements, 6).
        region: Region of each element, shape (elements,).
    """

    connectivity: Indices
    batches: "Batches"
    gradients: Floats
    weights: Floats
    values: Floats
    coefficients: Floats
    region: Indices

    def attach(self, pattern: Pattern) -> "Solids":
        """Find where the blocks go in a pattern."""
        slots = pattern.locate(self.connectivity)
        padded = np.where(self.batches.padding[:, None, None], np.int32(FIXED), slots[self.batches.element])
        grouped = padded.reshape(-1, SIMD_WIDTH, *slots.shape[1:]).transpose(0, 2, 3, 1)
        return replace(self, batches=replace(self.batches, slots=np.ascontiguousarray(grouped)))

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
        batches = self.batches
        return bool(
            solid_forces(
                positions, batches.connectivity, batches.gradients, batches.weights, batches.coefficients,
                scales[batches.region], batches.hourglass, batches.slots, forces, values, tangent,
            )
        )  # fmt: skip

    def deformation(self, positions: Floats) -> Floats:
        """Compute the deformation gradients, shape (elements, points, 3, 3)."""
        corners = positions[self.connectivity]
        return np.asarray(np.einsum("enjq,eni->eqij", self.gradients, corners))

    def nodal_mass(self, density: Floats, nodes: int) -> Floats:
        """Integrate the density of each region [kg/m3] against the shape functions [kg], shape (nodes,)."""
        mass = np.einsum("eq,qn->en", self.weights * density[self.region][:, None], self.values)
        return np.bincount(self.connectivity.ravel(), mass.ravel(), minlength=nodes).astype(np.float64)

    def energy_and_stress(self, positions: Floats, scales: Floats) -> tuple[Floats, Floats]:
        """Compute strain energy per volume [J/m3] and von Mises stress [Pa], both of shape (elements,)."""
        deformation = self.deformation(positions)
        ratio = np.linalg.det(deformation)
        mean = (self.weights * ratio).sum(axis=1) / self.weights.sum(axis=1)
        cauchy_green = np.einsum("eqij,eqkj->eqik", deformation, deformation) * ratio[..., None, None] ** (
            -2.0 / 3.0
        )
        excess = np.trace(cauchy_green, axis1=2, axis2=3) - 3.0
        energy, slope = _isochoric(excess, self.coefficients)
        deviator = (
            2.0
            * (slope / ratio)[..., None, None]
            * (cauchy_green - (excess / 3.0 + 1.0)[..., None, None] * np.eye(3))
        )
        von_mises = np.sqrt(1.5 * np.einsum("eqij,eqij->eq", deviator, deviator))
        share = self.weights / self.weights.sum(axis=1, keepdims=True)
        volumetric = 0.25 * self.coefficients[:, 2] * (mean**2 - 1.0 - 2.0 * np.log(mean))
        energy = energy + 0.25 * self.coefficients[:, 5, None] * (ratio**2 - 1.0 - 2.0 * np.log(ratio))
        scale = scales[self.region]
        return scale * ((share * energy).sum(axis=1) + volumetric), scale * (share * von_mises).sum(axis=1)


def _isochoric(excess: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """Compute psi and psi' at I - 3 = ``excess``, both of shape (elements, points)."""
    code, half, _, a, b = (coefficients[:, k, None] for k in range(5))
    # Every law is evaluated everywhere and one chosen below; the others may give infinity there.
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
    """Precompute the geometry of a block at rest; it is not yet attached to a pattern.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        block: Elements.
        materials: Material of each region.

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
    gradients = np.einsum("qnk,eqkj->enjq", slopes, np.linalg.inv(jacobian))
    connectivity = np.array(block.connectivity, dtype=np.int64)
    region = np.array(block.region, dtype=np.int64)
    table = np.array([material.coefficients() for material in materials])
    weights = measure * parent_weights
    coefficients = _split_bulk(table[region], LOCAL_BULK[block.kind])
    hourglass = HOURGLASS[block.kind] * _hourglass(corners, weights, 2.0 * coefficients[:, 1])
    batches = _batches(connectivity, gradients, weights, coefficients, hourglass, region)
    return Solids(connectivity, batches, gradients, weights, values, coefficients, region)


def _hourglass(corners: Floats, weights: Floats, shear: Floats) -> Floats:
    """Project nodal values on what no quadratic explains, scaled, shape (elements, nodes, nodes)."""
    nodes = corners.shape[1]
    edge = np.cbrt(weights.sum(axis=1))
    # Over the element's size, or rounding would hide the quadratic terms.
    x, y, z = np.moveaxis((corners - corners.mean(axis=1, keepdims=True)) / edge[:, None, None], 2, 0)
    terms = [np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]
    # Ten quadratic terms explain ten nodes: there is no hourglass mode to hold.
    if nodes <= len(terms):
        return np.zeros((len(corners), nodes, nodes))
    # With orthonormal columns Q of the quadratics, 1 - Q Q^T is zero for all motions that they explain.
    basis = np.linalg.qr(np.stack(terms, axis=2))[0]
    return np.asarray((shear * edge)[:, None, None] * (np.eye(nodes) - basis @ basis.transpose(0, 2, 1)))


def _split_bulk(table: Floats, limit: float) -> Floats:
    """Divide the bulk modulus between the element's mean and its points, shape (elements, 5) to (., 6)."""
    # A material whose bulk modulus is below the limit does not lock: it is held at the points alone.
    local = np.minimum(table[:, 2], limit * 2.0 * table[:, 1])
    split = np.column_stack([table, local])
    split[:, 2] -= local
    return split


def _batches(
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    coefficients: Floats,
    hourglass: Floats,
    region: Indices,
) -> Batches:
    """Group elements by lanes; the last one fills up what is left over, with nodes -1 - n."""
    element, padding = simd_groups(len(connectivity), SIMD_WIDTH)
    # -1 - n still encodes the node to read from; its sign marks that nothing is added there.
    nodes = np.where(padding[:, None], -1 - connectivity[element], connectivity[element])

    def grouped(values: Floats) -> Floats:
        return simd_axis_last(values[element], SIMD_WIDTH)

    return Batches(
        element=element,
        padding=padding,
        connectivity=np.ascontiguousarray(nodes.reshape(-1, SIMD_WIDTH, connectivity.shape[1])),
        gradients=grouped(gradients.transpose(0, 1, 3, 2)),
        weights=grouped(weights),
        coefficients=np.ascontiguousarray(coefficients[element].reshape(-1, SIMD_WIDTH, 6)),
        hourglass=grouped(hourglass),
        region=region[element].reshape(-1, SIMD_WIDTH),
        slots=np.empty((0, connectivity.shape[1], connectivity.shape[1], SIMD_WIDTH), dtype=np.int32),
    )
