"""From the description of a specimen to the mesh of its body."""

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.geometry.checks import check_mesh
from softarm.estimator.geometry.cross_sections import (
    block_patches,
    cylinder_patches,
    lobe_patches,
    quadrant_patches,
)
from softarm.estimator.geometry.mesh_file import read_mesh
from softarm.estimator.geometry.resolution import DEFAULTS, Resolution
from softarm.estimator.geometry.sweep import sweep
from softarm.estimator.mesh import Mesh
from softarm.estimator.specimen import Block, Cylinder, MeshFile, QuadrantCylinder, Specimen, SweptLobes
from softarm.estimator.specimen.body import AZIMUTH_TOLERANCE_RAD


def build_mesh(specimen: Specimen, resolution: Resolution | None = None) -> Mesh:
    """Mesh the body of a specimen.

    A mesh from a file is taken as it is, whatever the resolution; that of a parametric body is
    ``DEFAULTS`` when left out.

    Returns:
        A mesh with one region per segment and section, surfaces ``chamber_<k>`` and ``outer``, and node sets
        ``clamp`` and ``section_<name>``; all checked.

    Raises:
        InputError: The description cannot be meshed, or it does not describe the mesh file.
    """
    geometry = specimen.geometry
    resolution = resolution or DEFAULTS[geometry.kind]
    where = f"{specimen.name}: geometry"
    match geometry:
        case MeshFile():
            return read_mesh(specimen, geometry)
        case SweptLobes():
            azimuth, lobes = _lobes(specimen, 3)
            mesh = sweep(
                specimen,
                lambda height: lobe_patches(geometry, height, azimuth, resolution),
                lobes,
                geometry.station_heights_m,
                resolution,
            )
        case QuadrantCylinder():
            azimuth, lobes = _lobes(specimen, 4)
            patches = quadrant_patches(geometry, azimuth, resolution)
            mesh = sweep(specimen, lambda _: patches, lobes, (), resolution)
        case Cylinder():
            azimuth, lobes = _lobes(specimen, specimen.chambers_per_segment)
            patches = cylinder_patches(geometry, azimuth, len(lobes), resolution)
            mesh = sweep(specimen, lambda _: patches, lobes, (), resolution)
        case Block():
            patches = block_patches(geometry, resolution)
            mesh = sweep(specimen, lambda _: patches, (), (), resolution)
    return check_mesh(mesh, where)


def _lobes(specimen: Specimen, count: int) -> tuple[float, list[tuple[int, ...]]]:
    """Compute the azimuth of lobe 0 [rad] and the chambers in each lobe.

    Raises:
        InputError: The segments' chambers do not lie above each other.
    """
    start = specimen.chambers[0].azimuth_rad
    lobes: list[list[int]] = [[] for _ in range(count)]
    for chamber in specimen.chambers:
        spacing = 2.0 * np.pi / count
        fractions = (chamber.azimuth_rad - start) / spacing
        if abs(fractions - round(fractions)) * spacing > AZIMUTH_TOLERANCE_RAD:
            raise InputError(
                f"{specimen.name}: chambers[{chamber.index}].azimuth_rad",
                f"{chamber.azimuth_rad} rad is not in line with a chamber of the first segment",
                "give all segments the same azimuths, or use a mesh file",
            )
        lobes[round(fractions) % count].append(chamber.index)
    return start, [tuple(members) for members in lobes]
