"""Four-sided patches of a cross-section, and the grids of quadratic quadrilaterals on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softarm.estimator.arrays import Floats, Indices

Curve = Callable[[Floats], Floats]

# Far above rounding and far below any wall: nearer points are one node.
MERGE_TOLERANCE_M = 1e-8


class Patch(NamedTuple):
    """A four-sided part of a cross-section, counter-clockwise: south (s), east (t), north (s), west (t).

    Each side maps a parameter in [0, 1], shape (n,), to points [m], shape (n, 2); south and north run with s,
    east and west with t. ``cavity`` numbers the lobe whose chamber the patch fills; -1 is always solid.
    """

    south: Curve
    east: Curve
    north: Curve
    west: Curve
    divisions: tuple[int, int]
    cavity: int = -1


def line(start: Floats, end: Floats) -> Curve:
    """Build the straight line between two points, each of shape (2,)."""
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    return lambda s: first + np.multiply.outer(s, last - first)


def arc(centre: Floats, radius: float, start: float, end: float) -> Curve:
    """Build the circular arc about a centre between two angles [rad]."""
    middle = np.asarray(centre, dtype=float)

    def points(s: Floats) -> Floats:
        angle = start + s * (end - start)
        return middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    return points


def transform(curve: Curve, rotation: float, shift: Floats) -> Curve:
    """Rotate a curve about the origin [rad] and shift it [m]."""
    c, s = np.cos(rotation), np.sin(rotation)
    rotate_axes = np.array([[c, -s], [s, c]])
    return lambda parameter: curve(parameter) @ rotate_axes.T + shift


def straight(corners: Sequence[Floats], divisions: tuple[int, int]) -> Patch:
    """Build the patch with straight sides between four corners, counter-clockwise."""
    a, b, c, d = (np.asarray(corner, dtype=float) for corner in corners)
    return Patch(line(a, b), line(b, c), line(d, c), line(a, d), divisions)


def moved(patch: Patch, rotation: float, shift: Floats) -> Patch:
    """Rotate a patch about the origin [rad] and shift it [m]."""
    return patch._replace(
        south=transform(patch.south, rotation, shift),
        east=transform(patch.east, rotation, shift),
        north=transform(patch.north, rotation, shift),
        west=transform(patch.west, rotation, shift),
    )


def sample(patch: Patch) -> Floats:
    """Place the patch's nodes by transfinite interpolation (Gordon and Hall 1973).

    Corners and mid-sides, shape ((2 m + 1) (2 n + 1), 2), s running first.
    """
    m, n = patch.divisions
    s, t = np.linspace(0.0, 1.0, 2 * m + 1), np.linspace(0.0, 1.0, 2 * n + 1)
    south, north, west, east = patch.south(s), patch.north(s), patch.west(t), patch.east(t)
    u, v = s[None, :, None], t[:, None, None]
    sides = (1.0 - v) * south[None] + v * north[None] + (1.0 - u) * west[:, None] + u * east[:, None]
    corners = (1.0 - u) * ((1.0 - v) * south[0] + v * north[0]) + u * ((1.0 - v) * south[-1] + v * north[-1])
    points: Floats = (sides - corners).reshape(-1, 2)
    return points


@dataclass(frozen=True)
class PatchLayout:
    """How the nodes of a cross-section make quadrilaterals; the same at every height.

    Args:
        quads: Nodes of each quadrilateral, four corners then four mid-sides, shape (quads, 8).
        cavity: Number of the lobe whose chamber each quadrilateral fills, -1 for solid, shape (quads,).
        merge: Node of every sampled point, shape (samples,).
        nodes: Number of nodes.
    """

    quads: Indices
    cavity: Indices
    merge: Indices
    nodes: int

    def place(self, patches: Sequence[Patch]) -> Floats:
        """Place the nodes for the patches of one height [m], shape (nodes, 2)."""
        points = np.empty((self.nodes, 2))
        points[self.merge] = np.concatenate([sample(patch) for patch in patches])
        return points


def build_plan(patches: Sequence[Patch]) -> PatchLayout:
    """Join patches into one plan; sides that touch must have the same points."""
    samples = [sample(patch) for patch in patches]
    _, first, merge = np.unique(
        np.round(np.concatenate(samples) / MERGE_TOLERANCE_M).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    merge = merge.ravel()
    quads, cavity, offset = [], [], 0
    for patch, points in zip(patches, samples, strict=True):
        quads.append(merge[offset + _grid(*patch.divisions)])
        cavity.append(np.full(len(quads[-1]), patch.cavity))
        offset += len(points)
    return _without_centres(np.concatenate(quads), np.concatenate(cavity), merge, len(first))


def _grid(m: int, n: int) -> Indices:
    """Number the quadrilaterals of an m by n grid of corners and mid-sides, shape (m n, 8)."""
    row = 2 * m + 1
    corner = (2 * np.arange(n)[:, None] * row + 2 * np.arange(m)[None, :]).reshape(-1, 1)
    grid: Indices = corner + np.array([0, 2, 2 * row + 2, 2 * row, 1, row + 2, 2 * row + 1, row])
    return grid


def _without_centres(quads: Indices, cavity: Indices, merge: Indices, nodes: int) -> PatchLayout:
    """Drop the centres of the quadrilaterals, which eight-node ones do not have."""
    used = np.zeros(nodes + 1, dtype=bool)
    used[quads] = True
    # All centres share one last number, which `place` writes to and no quadrilateral reads.
    number = np.where(used, np.cumsum(used) - 1, used.sum())
    return PatchLayout(number[quads], cavity, number[merge], int(used.sum()) + 1)
