"""Frames of rigid sections: the rigid motion that fits a set of material points best.

A frame depends on the nodes through few linear functions of them, its moments: the mean of the section's
points x_s and, column by column, M = sum_s x_s c_s^T with the arms c. A single material point counts as a
section too: it has a position, and axes that never rotate.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.errors import InputError
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.interpolation import PointMap, cross_section, node_map, points_inside
from softarm.estimator.mesh import Mesh
from softarm.estimator.model import Frames
from softarm.estimator.rotations import skew

MOMENTS = 4
"""Moments of a section: the mean of its points and three columns."""


@dataclass(frozen=True)
class SectionNodes:
    """A rigid section whose frame the model predicts.

    Args:
        name: Name of the section; its points are the node set ``section_<name>`` unless ``point`` is given.
        origin: Rest position of the frame's origin [m]; the mean of its points when left out.
        rotation: Rest rotation of the frame, row by row, shape (3, 3); the base frame's when left out.
        point: A material point at rest [m], such as a marker on soft skin, to be followed alone.
    """

    name: str
    origin: tuple[float, float, float] | None = None
    rotation: tuple[tuple[float, float, float], ...] | None = None
    point: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class SectionFrame:
    """The best-fit frame of a set of points (Kabsch 1976), with equal weights.

    Args:
        moments: Moments per nodal value: the mean, then three with the arms c (rest positions of the points
            less their mean, over their number [m]); zero for a single point, shape (4, nodes).
        mean: Mean of the rest positions of the points [m], shape (3,).
        origin: Rest position of the frame's origin [m], shape (3,).
        rotation: Rest rotation of the frame, shape (3, 3).
    """

    moments: Floats
    mean: Floats
    origin: Floats
    rotation: Floats


@dataclass(frozen=True)
class SectionFit:
    """The fit of several frames at once.

    Args:
        weights: Their moments per nodal value, shape (4 sections, nodes).
        offsets: Rest position of each frame's origin less the mean of its points [m], shape (sections, 3).
        rotations: Rest rotations of the frames, shape (sections, 3, 3).
        single: Whether a section is a single point, shape (sections,).
    """

    weights: Floats
    offsets: Floats
    rotations: Floats
    single: Flags

    @classmethod
    def of(cls, frames: Sequence[SectionFrame], nodes: int) -> "SectionFit":
        """Collect the frames of a mesh with a number of nodes."""
        count = len(frames)
        return cls(
            weights=np.array([frame.moments for frame in frames]).reshape(MOMENTS * count, nodes),
            offsets=np.array([frame.origin - frame.mean for frame in frames]).reshape(count, 3),
            rotations=np.array([frame.rotation for frame in frames]).reshape(count, 3, 3),
            single=np.array([not frame.moments[1:].any() for frame in frames], dtype=np.bool_),
        )

    def at(self, positions: Floats) -> "SectionPoses":
        """Fit the frames to current nodes [m], shape (nodes, 3)."""
        return self.from_moments(self.weights @ positions)

    def from_moments(self, moments: Floats) -> "SectionPoses":
        """Fit the frames to the moments of the nodes, shape (4 sections, 3).

        With M = R U (polar), R is the rotation since rest. Where a search has diverged it is NaN.
        """
        # A section's rows: the mean, then the columns of M.
        count = len(self.offsets)
        stacked = moments.reshape(count, MOMENTS, 3)
        since_rest, spins = _fit_rotations(stacked[:, 1:], self.single)
        levers = (since_rest @ self.offsets[:, :, None])[:, :, 0]
        frames = Frames(stacked[:, 0] + levers, since_rest @ self.rotations)
        return SectionPoses(self.weights, frames, since_rest, spins, levers)


@dataclass(frozen=True)
class SectionPoses:
    """Frames of several sections at a configuration, with the derivative of their twists.

    Args:
        weights: Moments per nodal value, shape (4 sections, nodes).
        frames: Positions and rotations of the frames.
        since_rest: Rotations R since rest, shape (sections, 3, 3).
        spins: Matrices R (tr U - U)^-1 of w = spin sum_s c_s x R^T dx_s, shape (sections, 3, 3).
        levers: From the mean of each section's points to its frame's origin [m], shape (sections, 3).
    """

    weights: Floats
    frames: Frames
    since_rest: Floats
    spins: Floats
    levers: Floats

    def twists(self, displacements: Floats) -> Floats:
        """Compute the stacked twists of displacements of the nodes [m], shape (displacements, 6 sections)."""
        return self.twists_of_moments(self.weights @ displacements)

    def twists_of_moments(self, moments: Floats) -> Floats:
        """Compute the stacked twists of displacements from their moments, shape (., 4 sections, 3)."""
        twists = np.empty((len(moments), 6 * len(self.since_rest)))
        moments = np.ascontiguousarray(moments)
        section_twists(moments, self.since_rest, self.spins, self.levers, twists)
        return twists

    def moment_rows(self, rows: Floats) -> Floats:
        """Pull rows on the stacked twists back to the moments, shape (rows, 4 sections, 3)."""
        count = len(self.since_rest)
        stacked = rows.reshape(len(rows), count, 6)
        shift, twist = stacked[..., :3], stacked[..., 3:]
        axes = np.einsum("rsi,sij->rsj", twist + np.cross(self.levers, shift), self.spins)
        # Column j of M has the sensitivity R (axes x e_j), and [axes] holds axes x e_j in its columns.
        columns = np.einsum("sik,rskj->rsji", self.since_rest, skew(axes))
        return np.concatenate([shift[:, :, None], columns], axis=2).reshape(len(rows), MOMENTS * count, 3)

    def pull_back(self, rows: Floats) -> Floats:
        """Pull rows on the stacked twists back to the nodes, shape (rows, nodes, 3): conjugate forces."""
        nodal: Floats = self.weights.T @ self.moment_rows(rows)
        return nodal


def frame_of_points(points: PointMap, mesh: Mesh, origin: Floats | None, rotation: Floats) -> SectionFrame:
    """Prepare the best-fit frame of points.

    Args:
        points: The points on the mesh.
        mesh: Mesh at rest.
        origin: Rest position of the frame's origin [m]; the mean of the points when left out.
        rotation: Rest rotation of the frame, shape (3, 3).
    """
    rest = points.apply(mesh.points)
    mean = rest.mean(axis=0)
    arms = (rest - mean) / len(rest)
    matrix = points.matrix(len(mesh.points))
    moments = np.vstack([np.asarray(matrix.mean(axis=0)), arms.T @ matrix])
    return SectionFrame(moments, mean, mean if origin is None else origin, rotation)


def _frame(points: PointMap, mesh: Mesh, origin: Floats | None, rotation: Floats, where: str) -> SectionFrame:
    rest = points.apply(mesh.points)
    spread = np.linalg.svd(rest - rest.mean(axis=0), compute_uv=False)
    # Points in one line leave the rotation about it open.
    if len(rest) < 3 or spread[1] < 1e-6 * max(spread[0], 1e-12):
        raise InputError(where, "fewer than three points that are not in line", "give it more nodes")
    return frame_of_points(points, mesh, origin, rotation)


def build_section(mesh: Mesh, section: SectionNodes) -> SectionFrame:
    """Prepare the frame of a named section.

    Raises:
        InputError: The mesh has no such node set, too few nodes in it, or the point lies outside the body.
    """
    rotation = np.eye(3) if section.rotation is None else np.array(section.rotation)
    where = f"section {section.name!r}"
    if section.point is not None:
        place = np.array([section.point])
        return frame_of_points(points_inside(mesh, place, where), mesh, place[0], rotation)
    nodes = mesh.node_sets.get(f"section_{section.name}")
    if nodes is None or not len(nodes):
        names = ", ".join(sorted(n for n in mesh.node_sets if n.startswith("section_"))) or "none"
        raise InputError(where, f"the mesh has no node set for it (it has {names})", "name it in the mesh")
    origin = None if section.origin is None else np.array(section.origin)
    return _frame(node_map(nodes), mesh, origin, rotation, where)


def build_slice(mesh: Mesh, height: float) -> SectionFrame:
    """Prepare the frame of the cross-section at a height [m].

    Raises:
        InputError: The height is outside the body.
    """
    return _frame(cross_section(mesh, height), mesh, None, np.eye(3), f"height {height} m")


def _fit_rotations(columns: Floats, single: Flags) -> tuple[Floats, Floats]:
    """Compute R and R (tr U - U)^-1 from the columns of M = R U, shape (sections, 3, 3), by column."""
    valid = np.isfinite(columns).all(axis=(1, 2), keepdims=True)  # the decomposition of NaN raises
    left, values, right = np.linalg.svd(np.where(valid, columns, np.eye(3)).swapaxes(1, 2))
    mirrored = np.linalg.det(left @ right) < 0.0
    # A reflection fits best: the nearest rotation reverses the direction of the smallest singular value.
    left[mirrored, :, 2] *= -1.0
    values[mirrored, 2] *= -1.0
    # (tr U - U)^-1 in the eigenbasis of U, whose eigenvalues are the (signed) singular values.
    spread = values.sum(axis=1, keepdims=True) - values
    # A single point never rotates, whatever its neighbours do.
    spread[single] = np.inf
    left = np.where(valid, left, np.nan)
    since_rest = np.where(single[:, None, None], np.eye(3), left @ right)
    return since_rest, left @ (right / spread[:, :, None])


@compiled
def section_twists(
    moments: Floats, since_rest: Floats, spins: Floats, levers: Floats, twists: Floats
) -> None:
    """Fill the twists w = spin sum_s c_s x R^T v_s and v_mean + w x lever of fields v.

    ``moments`` are those of the fields, shape (fields, 4 sections, 3).
    """
    rotated, axial = np.empty((3, 3)), np.empty(3)
    for f in range(moments.shape[0]):
        for s in range(since_rest.shape[0]):
            for j in range(3):
                for i in range(3):
                    rotated[j, i] = 0.0
                    for k in range(3):
                        rotated[j, i] += moments[f, 4 * s + 1 + j, k] * since_rest[s, k, i]
            for i in range(3):
                axial[i] = rotated[(i + 1) % 3, (i + 2) % 3] - rotated[(i + 2) % 3, (i + 1) % 3]
            out = twists[f, 6 * s : 6 * s + 6]
            for i in range(3):
                out[3 + i] = 0.0
                for k in range(3):
                    out[3 + i] += spins[s, i, k] * axial[k]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                out[i] = moments[f, 4 * s, i] + out[3 + j] * levers[s, k] - out[3 + k] * levers[s, j]
