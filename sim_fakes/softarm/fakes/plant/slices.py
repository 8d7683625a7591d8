"""Cross-sections of a mesh file: what of a grid lies inside its elements at a height."""

from dataclasses import dataclass
from typing import Self

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import Chamber, MeshFile, Specimen
from softarm.fakes.plant.rotations import rotation_matrix

Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

CORNERS = {"tetra": 4, "tetra10": 4, "hexahedron": 8, "hexahedron20": 8, "hexahedron27": 8}
TETRAHEDRA_OF_HEXAHEDRON = ((0, 1, 3, 4), (1, 2, 3, 6), (1, 4, 5, 6), (3, 4, 6, 7), (1, 3, 4, 6))
EDGE = 1e-9


@dataclass(frozen=True)
class MeshSlices:
    """The corners of a mesh's elements, cut into tetrahedra.

    Args:
        name: Of the file, for messages.
        corners: Base frame [m], shape (tetrahedra, 4, 3).
    """

    name: str
    corners: Floats

    @classmethod
    def read(cls, specimen: Specimen, file: MeshFile) -> Self:
        """Read the mesh of a specimen.

        Raises:
            InputError: It cannot be read.
        """
        path = specimen.folder / file.path
        try:
            mesh = meshio.read(path)
        except (meshio.ReadError, OSError, ValueError, KeyError, SystemExit) as error:
            raise InputError(
                str(path), f"cannot be read ({error})", "run softarm check on the specimen"
            ) from None
        points = np.asarray(mesh.points, dtype=float) * file.metres_per_unit
        points = points @ rotation_matrix(np.array(file.quaternion)).T + np.array(file.origin_m)
        cells = [
            _tetrahedra(block.type, np.asarray(block.data)) for block in mesh.cells if block.type in CORNERS
        ]
        if not cells:
            raise InputError(str(path), "has no solid elements", "export tetrahedra or hexahedra")
        return cls(path.name, points[np.concatenate(cells)])

    @property
    def reach(self) -> float:
        """Half width of the square around the body [m]."""
        return float(np.abs(self.corners[..., :2]).max())

    def outline(
        self, height: float, points: Floats, chambers: tuple[Chamber, ...]
    ) -> tuple[Mask, list[Mask]]:
        """Return which points lie inside the outer boundary, and inside each chamber; see ``Outline``.

        Raises:
            InputError: There is no hollow in the direction of a chamber.
        """
        side = round(np.sqrt(len(points)))
        solid = self._inside(height, points).reshape(side, side)
        filled = ndimage.binary_fill_holes(solid)
        labels, count = ndimage.label(filled & ~solid)
        flat = labels.ravel()
        centres = [points[flat == label].mean(axis=0) for label in range(1, count + 1)]
        return filled.ravel(), [flat == self._hollow(chamber, centres) for chamber in chambers]

    def _hollow(self, chamber: Chamber, centres: list[Floats]) -> int:
        """Return the label of the hollow that is nearest to a chamber's azimuth."""
        away = [np.angle(np.exp(1j * (np.arctan2(y, x) - chamber.azimuth_rad))) for x, y in centres]
        nearest = int(np.argmin(np.abs(away))) if away else -1
        if nearest < 0 or abs(away[nearest]) > 0.5:
            raise InputError(
                f"{self.name}, chambers[{chamber.index}]",
                f"the mesh has no closed hollow towards {chamber.azimuth_rad:g} rad",
                "correct azimuth_rad, from_m and to_m",
            )
        return nearest + 1

    def _inside(self, height: float, points: Floats) -> Mask:
        """Return which points at a height lie in an element, by barycentric coordinates."""
        low, high = self.corners[..., 2].min(axis=1), self.corners[..., 2].max(axis=1)
        inside = np.zeros(len(points), dtype=bool)
        for corners in self.corners[(low <= height) & (height < high)]:
            flat = corners[:, :2]
            near = np.flatnonzero(
                ((points >= flat.min(axis=0) - EDGE) & (points <= flat.max(axis=0) + EDGE)).all(axis=1)
            )
            away = np.column_stack([points[near], np.full(len(near), height)]) - corners[0]
            edges = corners[1:] - corners[0]
            if abs(np.linalg.det(edges)) > 0.0:
                weights = away @ np.linalg.inv(edges)
                fits = (weights >= -EDGE).all(axis=1) & (weights.sum(axis=1) <= 1.0 + EDGE)
                inside[near[fits]] = True
        return inside


def _tetrahedra(kind: str, cells: Integers) -> Integers:
    corners = cells[:, : CORNERS[kind]]
    if CORNERS[kind] == 4:
        return corners
    return np.concatenate([corners[:, list(part)] for part in TETRAHEDRA_OF_HEXAHEDRON])
