"""Meshes from files: what is read, checked against the specimen, and named."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.geometry.checks import check_elements, check_mesh
from softarm.estimator.geometry.faces import boundary_faces, connected_parts, is_among
from softarm.estimator.geometry.groups import MeshFileContent, read_content
from softarm.estimator.mesh import ElementBlock, ElementSurface, FacetKind, Mesh, without_orphans
from softarm.estimator.reference_elements import FACE_KIND
from softarm.estimator.specimen import Chamber, MeshFile, Section, Specimen

# Of the body's height, within which a node lies on a face.
FACE_TOLERANCE = 1e-4


def read_mesh(specimen: Specimen, geometry: MeshFile) -> Mesh:
    """Read a mesh and give its parts the specimen's names; the result is checked and in the base frame.

    Nodes that no element uses are dropped.

    Raises:
        InputError: The file cannot be read, a group is absent, an element is inverted, a chamber is empty
            or open, or a section lies outside the mesh; with the file, the field and the cure.
    """
    path = specimen.folder / geometry.path
    content = read_content(path)
    if not np.isfinite(content.points).all():
        raise InputError(f"{path}: geometry.path", "a node's coordinate is not finite", "mesh the body again")
    points = content.points_in_base(geometry.metres_per_unit, geometry.quaternion, geometry.origin_m)
    regions = _regions(specimen, geometry, content, points, path)
    blocks = tuple(
        ElementBlock(kind, connectivity, region)
        for (kind, connectivity), region in zip(content.blocks, regions, strict=True)
    )
    names = tuple(part.name for part in specimen.parts)
    mesh = Mesh(points, blocks, names, node_sets={"clamp": _clamp(specimen, geometry, content, points, path)})
    # Before the boundary is sought: an inverted element has its faces inside out.
    for block in blocks:
        check_elements(mesh, block, f"{path}: geometry.path")
    mesh = replace(mesh, surfaces=_surfaces(specimen, geometry, content, mesh, path))
    mesh = without_orphans(mesh)
    sections = {f"section_{section.name}": _section(mesh, section) for section in specimen.sections}
    for section in specimen.sections:
        if len(sections[f"section_{section.name}"]) < 3:
            raise InputError(
                f"{path}: sections.{section.name}",
                f"{section.from_m} to {section.to_m} m holds fewer than 3 of the mesh's nodes, which reach "
                f"from {mesh.points[:, 2].min():.4f} to {mesh.points[:, 2].max():.4f} m",
                "correct from_m and to_m, geometry.metres_per_unit, or the mesh's origin and axes",
            )
    return check_mesh(replace(mesh, node_sets={**mesh.node_sets, **sections}), f"{path}: geometry.path")


def _regions(
    specimen: Specimen, geometry: MeshFile, content: MeshFileContent, points: Floats, path: Path
) -> list[Indices]:
    """Find the part that each element of each block belongs to."""
    parts = specimen.parts
    regions = [np.full(len(connectivity), -1) for _, connectivity in content.blocks]
    if geometry.regions:
        for index, part in enumerate(parts):
            where = f"{path}: geometry.regions.{part.name}"
            if part.name not in geometry.regions:
                raise InputError(where, "missing", "name the group of this part's elements")
            for block, members in enumerate(content.elements(geometry.regions[part.name], where)):
                regions[block][members] = index
    else:
        ends = np.array([part.to_m for part in parts[:-1]])
        for block, (_, connectivity) in enumerate(content.blocks):
            regions[block] = np.searchsorted(ends, points[connectivity, 2].mean(axis=1))
    lost = sum(int((region < 0).sum()) for region in regions)
    if lost:
        raise InputError(
            f"{path}: geometry.regions",
            f"{lost} elements are in no part's group",
            "name groups that hold all",
        )
    for index, part in enumerate(parts):
        if not any((region == index).any() for region in regions):
            raise InputError(
                f"{path}: {part.name}", "no element lies in this part", "correct its group or its heights"
            )
    return regions


def _clamp(
    specimen: Specimen, geometry: MeshFile, content: MeshFileContent, points: Floats, path: Path
) -> Indices:
    if geometry.clamp is not None:
        return content.nodes(geometry.clamp, f"{path}: geometry.clamp")
    return np.flatnonzero(points[:, 2] <= specimen.clamp.up_to_m + _tolerance(points))


def _tolerance(points: Floats) -> float:
    return FACE_TOLERANCE * float(np.ptp(points[:, 2]))


def _section(mesh: Mesh, section: Section) -> Indices:
    """Find the nodes that carry a section's frame: held ones, or those that touch no other part."""
    if section.from_m == section.to_m:
        nodes = np.flatnonzero(np.abs(mesh.points[:, 2] - section.from_m) <= _tolerance(mesh.points))
    else:
        region = mesh.regions.index(section.name)
        mine, others = np.zeros(len(mesh.points), dtype=bool), np.zeros(len(mesh.points), dtype=bool)
        for block in mesh.blocks:
            mine[block.connectivity[block.region == region]] = True
            others[block.connectivity[block.region != region]] = True
        nodes = np.flatnonzero(mine & ~others)
        if len(nodes) < 3:
            nodes = np.flatnonzero(mine)
    held = np.intersect1d(nodes, mesh.node_sets["clamp"])
    return held if len(held) >= 3 else nodes


def _surfaces(
    specimen: Specimen, geometry: MeshFile, content: MeshFileContent, mesh: Mesh, path: Path
) -> dict[str, ElementSurface]:
    """Find the walls of the chambers on the boundary of the body."""
    if not specimen.chambers:
        return {}
    kind, boundary = _boundary(mesh, path)
    surfaces = {}
    inner = [] if geometry.chamber_surfaces else _inner_surfaces(mesh.points, kind, boundary)
    for chamber in specimen.chambers:
        where = f"{path}: geometry.chamber_surfaces.{chamber.index}"
        if geometry.chamber_surfaces:
            if str(chamber.index) not in geometry.chamber_surfaces:
                raise InputError(where, "missing", "name the group of facets of this chamber's wall")
            facets = content.facets(geometry.chamber_surfaces[str(chamber.index)], kind, where)
            on_boundary = is_among(kind, facets, boundary)
            if not on_boundary.all():
                raise InputError(
                    where,
                    f"{int((~on_boundary).sum())} of {len(facets)} facets are not on the body's surface",
                    "name the facets of the chamber's wall",
                )
            wall = boundary[is_among(kind, boundary, facets)]
        else:
            wall = boundary[_nearest_surface(chamber, mesh.points, boundary, inner, where)]
        surfaces[f"chamber_{chamber.index}"] = ElementSurface(kind, wall)
    return surfaces


def _boundary(mesh: Mesh, path: Path) -> tuple[FacetKind, Indices]:
    kinds = {FACE_KIND[block.kind] for block in mesh.blocks}
    if len(kinds) > 1:
        raise InputError(
            f"{path}: geometry.path",
            f"a body with chambers mixes elements with {' and '.join(sorted(kinds))} faces",
            "mesh it with elements of one kind",
        )
    connectivity = np.concatenate([block.connectivity for block in mesh.blocks])
    return kinds.pop(), boundary_faces(mesh.blocks[0].kind, connectivity)


def _inner_surfaces(points: Floats, kind: FacetKind, boundary: Indices) -> list[Indices]:
    """List the connected parts of the boundary but the largest, which is the outside."""
    parts = connected_parts(kind, boundary)
    spans = [float(np.ptp(points[boundary[rows]].reshape(-1, 3), axis=0).sum()) for rows in parts]
    outside = int(np.argmax(spans))
    return [rows for index, rows in enumerate(parts) if index != outside]


def _nearest_surface(
    chamber: Chamber, points: Floats, boundary: Indices, inner: list[Indices], where: str
) -> Indices:
    """Pick the inner surface between a chamber's heights whose azimuth is nearest."""
    # More than 30 degrees off it is another chamber's wall.
    best, angle = None, np.pi / 6.0
    for rows in inner:
        centre = points[boundary[rows]].reshape(-1, 3).mean(axis=0)
        azimuth = np.arctan2(centre[1], centre[0]) - chamber.azimuth_rad
        distance = abs((azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        if chamber.from_m < centre[2] < chamber.to_m and distance < angle:
            best, angle = rows, distance
    if best is None:
        raise InputError(
            where,
            f"no closed inner surface near {chamber.azimuth_rad:.3f} rad between {chamber.from_m} and "
            f"{chamber.to_m} m ({len(inner)} inner surfaces in all)",
            "close the chamber with end caps, name its facets, or correct its azimuth and heights",
        )
    return best
