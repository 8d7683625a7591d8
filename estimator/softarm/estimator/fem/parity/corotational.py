"""Co-rotational linear tetrahedra, with the exact derivative of their rotation.

With R the element's rotation since rest, K its linear stiffness, X and x the corners less the first,

    f_a = R sum_b K_ab (R^T x_b - X_b),   d f_a = sum_b K'_ab dx_b + (sum_b K'_ab [x_b] - [f_a]) w,

where K' = R K R^T, [v] is the cross-product matrix and w = sum_c W_c dx_c the spin of the frame. For a polar
frame of A = sum_a x_a c_a^T = R U, w = R (tr U - U)^-1 sum_a c_a x (R^T dx_a).
"""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.fem.elements.material import FRAME_CODES, Material
from softarm.estimator.fem.linalg.pattern import FIXED, Pattern, Slots
from softarm.estimator.fem.linalg.small import polar_rotations
from softarm.estimator.mesh import ElementBlock
from softarm.estimator.rotations import skew

# The polar rules come last, so that `rules > EDGES` finds them.
SMALL, POLAR = FRAME_CODES["small"], FRAME_CODES["corotational_polar"]
EDGES, EDGE_POLAR = FRAME_CODES["corotational"], FRAME_CODES["corotational_edge_polar"]


@dataclass(frozen=True)
class Tetrahedra:
    """Linear tetrahedra whose strain is measured in a frame that follows them.

    Args:
        connectivity: Nodes, shape (elements, 4).
        rest: Rest positions of the corners less that of the first [m], shape (elements, 4, 3).
        stiffness: Linear stiffness for a unit scale [N/m], shape (elements, 12, 12).
        frame: Rule of the frame: 0 none, 1 first three nodes, 2 or 3 polar, shape (elements,).
        fit: Coefficients c of the matrix sum_a x_a c_a^T of the polar rules, shape (elements, 4, 3).
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
        corners = positions[self.connectivity]
        arms = corners - corners[:, :1]
        frames, stretches = _frames(corners, self.frame, self.fit)
        rotations = frames @ _transposed(self.rest_frame)
        local = (arms @ rotations - self.rest).reshape(-1, 12, 1)
        scale = scales[self.region][:, None, None]
        internal = scale * (self.stiffness @ local).reshape(-1, 4, 3) @ _transposed(rotations)
        if not np.isfinite(internal).all():
            return False
        _add(forces, self.connectivity.ravel(), internal.reshape(-1, 3))
        if tangent:
            rotated = scale * _rotated(self.stiffness, rotations)
            spins = _spins(corners, frames, stretches, self.frame, self.fit)
            levers = rotated @ skew(arms).reshape(-1, 12, 3) - skew(internal).reshape(-1, 12, 3)
            self._add_blocks(rotated + levers @ spins, values, mirror)
        return True

    def _add_blocks(self, tangent: Floats, values: Floats, mirror: Floats) -> None:
        """Add the elements' tangents, shape (elements, 12, 12)."""
        blocks = tangent.reshape(-1, 4, 3, 4, 3).transpose(0, 1, 3, 2, 4)
        lower, upper = self.slots > FIXED, self.slots < FIXED
        diagonal = lower & np.eye(4, dtype=bool)
        _add(values, self.slots[lower], blocks[lower])
        _add(mirror, self.slots[diagonal], _transposed(blocks[diagonal]))
        _add(mirror, -2 - self.slots[upper], _transposed(blocks[upper]))

    def nodal_mass(self, density: Floats, nodes: int) -> Floats:
        """Share the mass of each element among its corners [kg], shape (nodes,)."""
        share = np.repeat(0.25 * self.volume * density[self.region], 4)
        return np.bincount(self.connectivity.ravel(), share, minlength=nodes).astype(np.float64)

    def energy_and_stress(self, positions: Floats, scales: Floats) -> tuple[Floats, Floats]:
        """Compute strain energy per volume [J/m3] and von Mises stress [Pa], both of shape (elements,)."""
        corners = positions[self.connectivity]
        rotations = _frames(corners, self.frame, self.fit)[0] @ _transposed(self.rest_frame)
        local = (corners - corners[:, :1]) @ rotations - self.rest
        strain_forces = np.einsum("eab,eb->ea", self.stiffness, local.reshape(-1, 12)).reshape(-1, 4, 3)
        scale = scales[self.region] / self.volume
        energy = 0.5 * scale * np.einsum("eni,eni->e", strain_forces, local)
        stress = scale[:, None, None] * np.einsum("eni,enj->eij", strain_forces, self.rest)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        return energy, np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator))


def build_tetrahedra(points: Floats, block: ElementBlock, materials: tuple[Material, ...]) -> Tetrahedra:
    """Precompute the linear stiffness and the rest frames; no pattern is attached yet.

    Args:
        points: Rest positions [m], shape (nodes, 3).
        block: Elements of kind ``tet4``.
        materials: Co-rotational material of each region.

    Raises:
        InputError: The elements are not linear tetrahedra, or one is inverted.
    """
    if block.kind != "tet4":
        raise InputError(
            "material", f"a co-rotational law on {block.kind} elements", "use tet4 or a hyperelastic law"
        )
    corners = points[block.connectivity]
    rest = corners - corners[:, :1]
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
    # SOFA's "polar" uses the rotation of the edges, the other polar rule that of the deformation gradient.
    unit_edges = np.vstack([-np.ones(3), np.eye(3)])
    fit = np.where((frame == EDGE_POLAR)[:, None, None], unit_edges, gradients)
    connectivity = np.array(block.connectivity, dtype=np.int64)
    return Tetrahedra(
        connectivity=connectivity,
        rest=rest,
        stiffness=_linear_stiffness(gradients, volume, [materials[k] for k in region]),
        frame=frame,
        fit=fit,
        rest_frame=_frames(corners, frame, fit)[0],
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
    return np.asarray(blocks.reshape(-1, 12, 12), dtype=np.float64)


def _frames(corners: Floats, rules: Indices, fit: Floats) -> tuple[Floats, Floats]:
    """Compute each element's frame and, for a polar rule, the stretch U, both of shape (elements, 3, 3)."""
    frames = np.tile(np.eye(3), (len(rules), 1, 1))
    edges, polar = rules == EDGES, rules > EDGES
    first, second = (corners[edges, k] - corners[edges, 0] for k in (1, 2))
    normal = np.cross(first, second)
    axes = first / _norm(first), normal / _norm(normal)
    frames[edges] = np.stack([axes[0], np.cross(axes[1], axes[0]), axes[1]], axis=2)
    matrices = _transposed(corners[polar]) @ fit[polar]
    frames[polar] = polar_rotations(np.ascontiguousarray(matrices))
    stretches = np.zeros_like(frames)
    stretches[polar] = _transposed(frames[polar]) @ matrices
    return frames, stretches


def _spins(corners: Floats, frames: Floats, stretches: Floats, rules: Indices, fit: Floats) -> Floats:
    """Compute the matrices W_a of the frames' spin, side by side, shape (elements, 3, 12)."""
    spins = np.zeros((len(rules), 4, 3, 3))
    edges, polar = rules == EDGES, rules > EDGES
    first, second = (corners[edges, k] - corners[edges, 0] for k in (1, 2))
    along, across, normal = np.moveaxis(frames[edges], 2, 0)
    length, height = _norm(first)[:, None], np.vecdot(second, across)[:, None, None]
    lean = np.vecdot(second, along)[:, None, None] / height
    # The third node rotates the frame about its first edge; the second also tilts that edge. A translation
    # rotates nothing, from which follows the first node's part.
    about_first = along[:, :, None] * normal[:, None]
    tilt = normal[:, :, None] * across[:, None] - across[:, :, None] * normal[:, None]
    spins[edges, 1] = (tilt - lean * about_first) / length
    spins[edges, 2] = about_first / height
    spins[edges, 0] = -spins[edges, 1] - spins[edges, 2]
    stretch = stretches[polar]
    system = np.trace(stretch, axis1=1, axis2=2)[:, None, None] * np.eye(3) - stretch
    per_moment = (frames[polar] @ np.linalg.inv(system))[:, None]
    spins[polar] = per_moment @ skew(fit[polar]) @ _transposed(frames[polar])[:, None]
    return spins.transpose(0, 2, 1, 3).reshape(-1, 3, 12)


def _rotated(stiffness: Floats, rotations: Floats) -> Floats:
    """Compute R K R^T of each pair of corners, shape (elements, 12, 12)."""
    blocks = np.zeros((len(rotations), 4, 3, 4, 3))
    for corner in range(4):
        blocks[:, corner, :, corner] = rotations
    each_corner = blocks.reshape(-1, 12, 12)
    rotated: Floats = each_corner @ stiffness @ _transposed(each_corner)
    return rotated


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, -1, -2)


def _norm(vectors: Floats) -> Floats:
    """Compute the lengths of vectors, shape (..., 1)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1, keepdims=True), dtype=np.float64)


def _add(target: Floats, places: Indices | Slots, blocks: Floats) -> None:
    """Add blocks at places along the first axis, which may repeat."""
    size = target[0].size if len(target) else 1
    entries = size * places[:, None].astype(np.int64) + np.arange(size)
    added = np.bincount(entries.ravel(), blocks.ravel(), minlength=target.size)
    target += added.reshape(target.shape)
