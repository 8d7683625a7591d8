"""Faces of elements: boundaries, walls between parts, and their orientation."""

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Indices
from softarm.estimator.mesh import ElementKind, FacetKind
from softarm.estimator.reference_elements import CORNERS, ELEMENT_FACES, FACE_KIND


def element_faces(kind: ElementKind, connectivity: Indices) -> Indices:
    """List all faces of some elements, normals outwards, shape (6 or 4 elements, nodes per face)."""
    faces = connectivity[:, ELEMENT_FACES[kind]]
    return faces.reshape(-1, faces.shape[-1])


def face_keys(kind: FacetKind, faces: Indices) -> Indices:
    """Compute a key that two faces on the same corners share, shape (faces, corners)."""
    return np.sort(faces[:, : CORNERS[kind]], axis=1)


def boundary_faces(kind: ElementKind, connectivity: Indices) -> Indices:
    """Keep the faces that belong to one element only, normals outwards."""
    faces = element_faces(kind, connectivity)
    _, inverse, count = np.unique(
        face_keys(FACE_KIND[kind], faces), axis=0, return_inverse=True, return_counts=True
    )
    outside: Indices = faces[count[inverse.ravel()] == 1]
    return outside


def is_among(kind: FacetKind, faces: Indices, others: Indices) -> NDArray[np.bool_]:
    """Check which faces share their corners with one of some other faces, shape (faces,)."""
    keys = np.concatenate([face_keys(kind, others), face_keys(kind, faces)])
    _, inverse = np.unique(keys, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    shared: NDArray[np.bool_] = np.isin(inverse[len(others) :], inverse[: len(others)])
    return shared


def open_edges(kind: FacetKind, facets: Indices) -> Indices:
    """List the directed edges of a surface that no facet runs the other way, shape (edges, 2)."""
    corners = facets[:, : CORNERS[kind]]
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    forward, count = np.unique(edges, axis=0, return_counts=True)
    keys = {(int(a), int(b)): int(n) for (a, b), n in zip(forward, count, strict=True)}
    broken = [edge for edge, n in keys.items() if n != 1 or keys.get((edge[1], edge[0])) != 1]
    return np.array(broken, dtype=np.int64).reshape(-1, 2)


def connected_parts(kind: FacetKind, facets: Indices) -> list[Indices]:
    """Split a surface into parts that share no corner; each part as rows of ``facets``."""
    corners = facets[:, : CORNERS[kind]]
    label = np.arange(int(corners.max()) + 1 if len(corners) else 0)
    while True:
        low = label[corners].min(axis=1)
        new = label.copy()
        np.minimum.at(new, corners, low[:, None])
        # Labels jump to the label of their label, so that a few passes join a surface of any size.
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    part = label[corners[:, 0]]
    return [np.flatnonzero(part == name) for name in np.unique(part)]
