"""Symmetries of the arm about its axis: they make one sample as good as several."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.model import Load
from softarm.estimator.rod.laws import features
from softarm.estimator.specimen import Chamber, Specimen


@dataclass(frozen=True)
class Symmetry:
    """A rotation or reflection that maps the arm to itself.

    Args:
        vectors: What it does to forces and displacements, shape (3, 3).
        axials: What it does to moments and rotations, shape (3, 3).
        chambers: Chamber that each chamber goes to, shape (chambers,).
    """

    vectors: Floats
    axials: Floats
    chambers: Indices


def candidates(specimen: Specimen) -> tuple[Symmetry, ...]:
    """List the rotations about z, with and without a reflection, that map chambers to chambers.

    The mirror's plane holds the axis and the first chamber, or the x axis where there is none.
    """
    start = specimen.chambers[0].azimuth_rad if specimen.chambers else 0.0
    mirror = _rotation_about_z(start) @ np.diag([1.0, -1.0, 1.0]) @ _rotation_about_z(-start)
    symmetries = []
    # Twelfths of a circle hold the symmetries of 2, 3, 4 and 6 chambers.
    for fold, mirrored in product(range(12), (False, True)):
        vectors = _rotation_about_z(np.pi * fold / 6) @ (mirror if mirrored else np.eye(3))
        moved = [_image(chamber, specimen.chambers, vectors) for chamber in specimen.chambers]
        if None not in moved:
            chambers = np.array(moved, dtype=np.int64).reshape(-1)
            # Moments and rotations are axial: a mirror reverses them beside mirroring.
            symmetries.append(Symmetry(vectors, vectors * np.linalg.det(vectors), chambers))
    return tuple(symmetries)


def verified(
    symmetries: Sequence[Symmetry],
    loads: Sequence[Load],
    twists: Floats,
    chambers: int,
    tolerance: float = 2e-3,
) -> tuple[Symmetry, ...]:
    """Keep those symmetries that the linear response at rest has.

    Args:
        symmetries: Candidates.
        loads: Forces and moments along x, y and z in this order on each section.
        twists: Twists of the stations per unit of each pressure, then each load, at rest and without
            gravity, shape (stations, 6, inputs).
        chambers: Number of chambers.
        tolerance: Largest difference over the largest entry of the response to an input.
    """
    size = np.abs(twists).max(axis=(0,), keepdims=True).max(axis=1, keepdims=True)
    kept = []
    for symmetry in symmetries:
        motion = np.zeros((6, 6))
        motion[:3, :3], motion[3:, 3:] = symmetry.vectors, symmetry.axials
        inputs = np.zeros((twists.shape[-1],) * 2)
        inputs[symmetry.chambers, np.arange(chambers)] = 1.0
        for k in range(0, len(loads), 3):
            block = symmetry.vectors if loads[k].kind == "force" else symmetry.axials
            rows = slice(chambers + k, chambers + k + 3)
            inputs[rows, rows] = block
        # What the moved inputs cause must be what the inputs cause, moved.
        if (np.abs(twists @ inputs - motion @ twists) <= tolerance * size).all():
            kept.append(symmetry)
    return tuple(kept)


def variable_map(symmetry: Symmetry, chambers: Indices, scale: Floats) -> Floats | None:
    """Compute what a symmetry does to the variables of a link's law, shape (variables, variables).

    Args:
        symmetry: The symmetry.
        chambers: Chambers around the link, without padding, shape (width,).
        scale: Unit of each variable, shape (6 + width,).

    Returns:
        The map, or ``None`` where it maps a chamber around the link to one elsewhere.
    """
    width = len(chambers)
    moved = symmetry.chambers[chambers] if width else np.zeros(0, dtype=np.int64)
    if set(moved.tolist()) != set(chambers.tolist()):
        return None
    matrix = np.zeros((6 + width, 6 + width))
    matrix[:3, :3], matrix[3:6, 3:6] = symmetry.vectors, symmetry.axials
    for k, target in enumerate(moved):
        matrix[6 + int(np.flatnonzero(chambers == target)[0]), 6 + k] = 1.0
    scaled: Floats = matrix * scale / scale[:, None]
    return scaled


def feature_map(table: Indices, variables: Floats) -> Floats:
    """Compute the matrix M with features(A x) = M features(x) for a linear map A of the variables.

    The terms must be closed under the map. M follows from the terms at random points.

    Args:
        table: Variables of each term, shape (terms, 4).
        variables: A, shape (variables, variables).
    """
    # Twice as many points as terms, so that their matrix is well conditioned.
    count = 2 * len(table)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (count, len(variables)))
    here, there = features(table, points), features(table, points @ variables.T)
    solution = np.linalg.lstsq(here, there, rcond=None)[0]
    return np.asarray(solution.T, dtype=np.float64)


def _rotation_about_z(angle: float) -> Floats:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _image(chamber: Chamber, chambers: Sequence[Chamber], vectors: Floats) -> int | None:
    """Find the chamber at the place to which a chamber is mapped."""
    direction = vectors @ np.array([np.cos(chamber.azimuth_rad), np.sin(chamber.azimuth_rad), 0.0])
    for other in chambers:
        there = np.array([np.cos(other.azimuth_rad), np.sin(other.azimuth_rad), 0.0])
        if other.segment == chamber.segment and np.linalg.norm(direction - there) < 1e-6:
            return other.index
    return None
