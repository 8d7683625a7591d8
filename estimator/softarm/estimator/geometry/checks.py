"""What every mesh has to fulfil before a model is built on it."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.geometry.faces import open_edges
from softarm.estimator.mesh import ElementBlock, Mesh
from softarm.estimator.shape_functions import quadrature, shape_functions, volume_form


def check_mesh(mesh: Mesh, where: str) -> Mesh:
    """Refuse a mesh on which no model can be built, naming ``where`` it came from; return it otherwise.

    Raises:
        InputError: Coordinates are not finite, an element is inverted, a chamber is empty, open or inside
            out, or no node is held or carries a section.
    """
    if not np.isfinite(mesh.points).all():
        raise InputError(where, "a node's coordinate is not finite", "correct the mesh")
    for block in mesh.blocks:
        check_elements(mesh, block, where)
    for name in mesh.surfaces:
        if name.startswith("chamber_"):
            _check_chamber(mesh, name, where)
    for name, nodes in mesh.node_sets.items():
        # Three nodes make a frame.
        needed = 1 if name == "clamp" else 3
        if len(nodes) < needed:
            raise InputError(
                where,
                f"node set '{name}' has {len(nodes)} nodes of the mesh, at least {needed} are needed",
                "correct its heights or its group, and the mesh's origin and axes",
            )
    return mesh


def jacobians(points: Floats, block: ElementBlock) -> Floats:
    """Compute det(dX / d parent) at the quadrature points [m3], shape (elements, quadrature points)."""
    _, gradients = shape_functions(block.kind, quadrature(block.kind)[0])
    ratios: Floats = np.linalg.det(np.einsum("qnj,eni->eqij", gradients, points[block.connectivity]))
    return ratios


def element_volumes(points: Floats, block: ElementBlock) -> Floats:
    """Integrate the rest volume of each element [m3], shape (elements,)."""
    return jacobians(points, block) @ quadrature(block.kind)[1]


def chamber_volume(mesh: Mesh, name: str) -> float:
    """Compute the rest volume that a chamber's wall encloses [m3]; its normals point into the chamber."""
    surface = mesh.surfaces[name]
    triples, coefficients = volume_form(surface.kind)
    corners = mesh.points[surface.facets]
    return -float((np.linalg.det(corners[:, triples]) @ coefficients).sum())


def check_elements(mesh: Mesh, block: ElementBlock, where: str) -> None:
    """Refuse elements that are inverted or flat at a quadrature point."""
    worst = jacobians(mesh.points, block).min(axis=1)
    bad = np.flatnonzero(~(worst > 0.0))
    if len(bad):
        place = mesh.points[block.connectivity[bad[0]]].mean(axis=0)
        raise InputError(
            where,
            f"{len(bad)} of {len(worst)} {block.kind} elements are inverted or flat, the first at "
            f"({place[0]:.4f}, {place[1]:.4f}, {place[2]:.4f}) m",
            "mesh the body again, or check the order of the elements' nodes",
        )


def _check_chamber(mesh: Mesh, name: str, where: str) -> None:
    surface = mesh.surfaces[name]
    if not len(surface.facets):
        raise InputError(where, f"{name} has no wall", "name the group of its facets, or correct its heights")
    edges = open_edges(surface.kind, surface.facets)
    if len(edges):
        place = mesh.points[edges[0]].mean(axis=0)
        raise InputError(
            where,
            f"the wall of {name} is open or not consistent at {len(edges)} edges, the first at "
            f"({place[0]:.4f}, {place[1]:.4f}, {place[2]:.4f}) m",
            "close the chamber with end caps",
        )
    if chamber_volume(mesh, name) <= 0.0:
        raise InputError(where, f"{name} encloses no volume", "name the facets of its inner wall")
