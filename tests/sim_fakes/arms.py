"""Specimens of arms that are not SoPrA: a cylinder with three chambers, and the same body as a mesh file."""

from pathlib import Path

import meshio
import numpy as np

from softarm.estimator.geometry import Resolution, build_mesh
from softarm.estimator.specimen import Specimen, load_specimen, save_specimen
from softarm.estimator.specimen.measures import (
    ArmMeasures,
    CylinderMeasures,
    SegmentMeasures,
    specimen_of_measures,
)


def three_chambers() -> Specimen:
    """One segment with three chambers in a cylinder."""
    shape = CylinderMeasures(3, outer_radius_m=0.018, wall_m=0.0025, core_radius_m=0.006)
    segments = (SegmentMeasures(0.1, 0.055, 0.01, 0.011),)
    measures = ArmMeasures("tri", 0.008, segments, shape, 264e3, 1140e3, 1070.0, 50e3, wound=True)
    return specimen_of_measures(measures)


def of_a_mesh_file(folder: Path) -> Specimen:
    """The same body as a mesh file beside its specimen, as a user would export it: linear hexahedra."""
    specimen = three_chambers()
    mesh = build_mesh(specimen, Resolution(around=2, layers=4))
    corners = mesh.blocks[0].connectivity[:, :8]
    used, numbers = np.unique(corners, return_inverse=True)
    cells = [("hexahedron", numbers.reshape(corners.shape))]
    meshio.write(folder / "arm.vtu", meshio.Mesh(mesh.points[used], cells))
    plain = specimen.model_dump(by_alias=True, exclude_defaults=True)
    plain["geometry"] = {"kind": "mesh_file", "path": "arm.vtu"}
    save_specimen(Specimen.model_validate(plain).placed_in(folder), folder / "arm.toml")
    return load_specimen(folder / "arm.toml")
