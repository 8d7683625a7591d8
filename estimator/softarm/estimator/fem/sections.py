"""Frames of rigid sections: the rigid motion that fits a set of material points best.

A single material point counts as a section too: it has a position, and axes that never turn.
"""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.fem.interpolation import PointMap, cross_section, node_map, points_inside
from softarm.estimator.mesh import Floats, Mesh


@dataclass(frozen=True)
class Section:
    """A rigid section whose frame the model gives.

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
        points: The points on the mesh.
        arms: Rest positions less their mean, over their number [m], shape (points, 3).
        mean: Mean of the rest positions [m], shape (3,).
        origin: Rest position of the frame's origin [m], shape (3,).
        rotation: Rest rotation of the frame, shape (3, 3).
    """

    points: PointMap
    arms: Floats
    mean: Floats
    origin: Floats
    rotation: Floats

    def at(self, positions: Floats) -> "FramePose":
        """Fit the frame to current nodes [m], shape (nodes, 3).

        With A = sum_s (x_s - x_mean) c_s^T and c the arms, A = R U (polar).
        """
        current = self.points.apply(positions)
        centre = current.mean(axis=0)
        if len(self.arms) == 1:
            return FramePose(self, centre, np.eye(3), np.zeros((3, 3)), centre, self.rotation)
        left, stretch, right = np.linalg.svd((current - centre).T @ self.arms)
        flip = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        turn = (left * flip) @ right
        # (tr U - U)^-1 in the eigenbasis of U, whose eigenvalues are the (signed) singular values.
        values = stretch * flip
        turning = (right.T / (values.sum() - values)) @ right
        return FramePose(
            frame=self,
            centre=centre,
            turn=turn,
            spin=turn @ turning,
            position=centre + turn @ (self.origin - self.mean),
            rotation=turn @ self.rotation,
        )


@dataclass(frozen=True)
class FramePose:
    """A section's frame at a configuration, with the derivative of its twist.

    Args:
        frame: What was fitted.
        centre: Mean of the points [m], shape (3,).
        turn: Rotation since rest, shape (3, 3).
        spin: Matrix R (tr U - U)^-1 of w = spin sum_s c_s x R^T dx_s, shape (3, 3).
        position: Origin of the frame [m], shape (3,).
        rotation: Rotation of the frame, shape (3, 3).
    """

    frame: SectionFrame
    centre: Floats
    turn: Floats
    spin: Floats
    position: Floats
    rotation: Floats

    def push(self, nodal: Floats) -> Floats:
        """Give the frame's twist (translation of the origin, rotation vector) of a displacement, shape (6,).

        Args:
            nodal: Displacement of the nodes, shape (nodes, 3).
        """
        moved = self.frame.points.apply(nodal)
        spin = self.spin @ np.cross(self.frame.arms, moved @ self.turn).sum(axis=0)
        shift = moved.mean(axis=0) + np.cross(spin, self.position - self.centre)
        return np.concatenate([shift, spin])

    def pull_back(self, rows: Floats, nodes: int) -> Floats:
        """Turn rows on the frame's twist into rows on the nodes, which are also the work-conjugate forces.

        Args:
            rows: Sensitivities to (translation of the origin, rotation vector), shape (rows, 6).
            nodes: Number of mesh nodes.

        Returns:
            Sensitivities to the nodes' displacement, shape (rows, nodes, 3).
        """
        shift, twist = rows[:, :3], rows[:, 3:]
        twist = twist + np.cross(self.position - self.centre, shift)
        axes = twist @ self.spin
        on_points = np.cross(axes[:, None, :], self.frame.arms[None]) @ self.turn.T
        on_points += shift[:, None, :] / len(self.frame.arms)
        nodal = np.zeros((len(rows), nodes, 3))
        if self.frame.points.nodes.shape[1] == 1:
            nodal[:, self.frame.points.nodes[:, 0]] = on_points
            return nodal
        spread = self.frame.points.weights[None, :, :, None] * on_points[:, :, None, :]
        for row in range(len(rows)):
            np.add.at(nodal[row], self.frame.points.nodes, spread[row])
        return nodal


def _frame(points: PointMap, mesh: Mesh, origin: Floats | None, rotation: Floats, where: str) -> SectionFrame:
    rest = points.apply(mesh.points)
    mean = rest.mean(axis=0)
    spread = np.linalg.svd(rest - mean, compute_uv=False)
    if len(rest) < 3 or spread[1] < 1e-6 * max(spread[0], 1e-12):
        raise InputError(where, "fewer than three points that are not in line", "give it more nodes")
    return SectionFrame(points, (rest - mean) / len(rest), mean, mean if origin is None else origin, rotation)


def build_section(mesh: Mesh, section: Section) -> SectionFrame:
    """Prepare the frame of a named section.

    Raises:
        InputError: The mesh has no such node set, too few nodes in it, or the point lies outside the body.
    """
    rotation = np.eye(3) if section.rotation is None else np.array(section.rotation)
    where = f"section {section.name!r}"
    if section.point is not None:
        place = np.array([section.point])
        return SectionFrame(points_inside(mesh, place, where), np.zeros((1, 3)), place[0], place[0], rotation)
    nodes = mesh.node_sets.get(f"section_{section.name}")
    if nodes is None or not len(nodes):
        known = ", ".join(sorted(n for n in mesh.node_sets if n.startswith("section_"))) or "none"
        raise InputError(where, f"the mesh has no node set for it (it has {known})", "name it in the mesh")
    origin = None if section.origin is None else np.array(section.origin)
    return _frame(node_map(nodes), mesh, origin, rotation, where)


def build_slice(mesh: Mesh, height: float) -> SectionFrame:
    """Prepare the frame of the cross-section at a height [m].

    Raises:
        InputError: The height is outside the body.
    """
    return _frame(cross_section(mesh, height), mesh, None, np.eye(3), f"height {height} m")
