"""Named groups of a mesh file: physical groups, cell and point sets, integers in data arrays."""

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError, suggest
from softarm.estimator.mesh import ElementKind, FacetKind
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen.entry import Quaternion, Vector

ELEMENTS: Mapping[str, ElementKind] = {
    "tetra": "tet4",
    "tetra10": "tet10",
    "hexahedron": "hex8",
    "hexahedron20": "hex20",
}
FACETS: Mapping[str, FacetKind] = {"triangle": "tri3", "triangle6": "tri6", "quad": "quad4", "quad8": "quad8"}
# Solids that meshio reads and that no element here stands for.
OTHER_SOLIDS = ("wedge", "pyramid", "hexahedron24", "hexahedron27", "polyhedron")
# What meshio's readers raise for broken files; each reader fails in its own way.
UNREADABLE = (meshio.ReadError, OSError, ValueError, KeyError, IndexError, AssertionError)


@dataclass(frozen=True)
class MeshFileContent:
    """A mesh file as it was read.

    Args:
        path: The file.
        points: Nodes in the file's units and axes, shape (nodes, 3).
        blocks: Kind and connectivity of each block of elements.
        mesh: What meshio made of the file.
    """

    path: Path
    points: Floats
    blocks: tuple[tuple[ElementKind, Indices], ...]
    mesh: Any

    def points_in_base(self, metres_per_unit: float, quaternion: Quaternion, origin_m: Vector) -> Floats:
        """Return the nodes in the base frame [m], shape (nodes, 3); see ``MeshFile``."""
        rotation = from_quaternions(np.array(quaternion))
        points: Floats = self.points * metres_per_unit @ rotation.T + np.array(origin_m)
        return points

    def elements(self, group: str, where: str) -> list[Indices]:
        """List the members of a group among the elements of each block.

        Raises:
            InputError: No element is in such a group.
        """
        cells = self._cells(group, where)
        members = [rows for block, rows in zip(self.mesh.cells, cells, strict=True) if block.type in ELEMENTS]
        self._must_hold(sum(map(len, members)), "elements", group, where)
        return members

    def facets(self, group: str, kind: FacetKind, where: str) -> Indices:
        """List the facets of a kind in a group, shape (facets, nodes per facet).

        Raises:
            InputError: No facet of this kind is in such a group.
        """
        cells = self._cells(group, where)
        members = [
            np.asarray(block.data, dtype=np.int64)[rows]
            for block, rows in zip(self.mesh.cells, cells, strict=True)
            if FACETS.get(block.type) == kind and len(rows)
        ]
        self._must_hold(len(members), f"facets ({kind})", group, where)
        return np.concatenate(members)

    def nodes(self, group: str, where: str) -> Indices:
        """List the nodes of a point set, or all nodes of the cells in a group.

        Raises:
            InputError: There is no such group, or it is empty.
        """
        if group in self.mesh.point_sets:
            return np.asarray(self.mesh.point_sets[group], dtype=np.int64).ravel()
        array, separator, value = group.partition("=")
        if separator and array in self.mesh.point_data:
            return np.flatnonzero(np.asarray(self.mesh.point_data[array]).ravel() == _number(value, where))
        cells = self._cells(group, where)
        members = [
            block.data[rows].ravel() for block, rows in zip(self.mesh.cells, cells, strict=True) if len(rows)
        ]
        self._must_hold(len(members), "nodes", group, where)
        return np.unique(np.concatenate(members)).astype(np.int64)

    def _cells(self, group: str, where: str) -> list[Indices]:
        """List the members of a group among all cells, block by block."""
        array, separator, value = group.partition("=")
        if group in self.mesh.field_data and "gmsh:physical" in self.mesh.cell_data:
            tag, dimension = self.mesh.field_data[group]
            return [
                np.flatnonzero(np.asarray(tags) == tag) if block.dim == dimension else np.empty(0, np.int64)
                for block, tags in zip(self.mesh.cells, self.mesh.cell_data["gmsh:physical"], strict=True)
            ]
        if group in self.mesh.cell_sets:
            return [
                np.asarray([] if rows is None else rows, dtype=np.int64)
                for rows in self.mesh.cell_sets[group]
            ]
        if separator and array in self.mesh.cell_data:
            number = _number(value, where)
            return [np.flatnonzero(np.asarray(v).ravel() == number) for v in self.mesh.cell_data[array]]
        names = self.group_names()
        cure = suggest(group, names, f"the file has {', '.join(names) or 'no groups'}")
        raise InputError(where, f"no group '{group}' in {self.path.name}", cure)

    def group_names(self) -> list[str]:
        """List every name that a group can have in this file."""
        names = [*self.mesh.field_data, *self.mesh.cell_sets, *self.mesh.point_sets]
        arrays = {**self.mesh.cell_data, **{k: [v] for k, v in self.mesh.point_data.items()}}
        for array, values in arrays.items():
            if array.startswith("gmsh:") and names:
                continue  # gmsh's own numbers, beside the names that its user gave
            flat = np.concatenate([np.asarray(v).ravel() for v in values])
            if np.issubdtype(flat.dtype, np.integer):
                names += [f"{array}={value}" for value in np.unique(flat)[:50]]
        return list(dict.fromkeys(names))

    def _must_hold(self, count: int, what: str, group: str, where: str) -> None:
        if not count:
            raise InputError(
                where, f"group '{group}' of {self.path.name} holds no {what}", "name another group"
            )


def read_content(path: Path) -> MeshFileContent:
    """Read a mesh file.

    Raises:
        InputError: The file is absent or unreadable, or holds no elements of a kind that is supported.
    """
    where = f"{path}: geometry.path"
    if not path.is_file():
        raise InputError(
            where, "no such mesh file", "correct the path, which starts at the specimen's folder"
        )
    printed = StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(printed):  # meshio prints why, then exits the program
            mesh = meshio.read(path)
    except SystemExit:
        why = " ".join(printed.getvalue().split()) or "its format is unknown"
        raise InputError(where, f"cannot read the mesh: {why}", "give a file that meshio reads") from None
    except UNREADABLE as error:
        raise InputError(where, f"cannot read the mesh: {error}", "give a file that meshio reads") from None
    other = sorted({block.type for block in mesh.cells if block.type.startswith(OTHER_SOLIDS)})
    if other:
        raise InputError(where, f"elements of kind {', '.join(other)}", f"use {', '.join(ELEMENTS)}")
    blocks = tuple(
        (ELEMENTS[block.type], np.asarray(block.data, dtype=np.int64))
        for block in mesh.cells
        if block.type in ELEMENTS
    )
    if not blocks:
        raise InputError(where, "it holds no solid elements", f"export {', '.join(ELEMENTS)}")
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    return MeshFileContent(path, points, blocks, mesh)


def _number(text: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(where, f"'{text}' is not a whole number", "give array=number") from None
