"""Swept bodies: their volume, their chambers, their symmetry, their orientation."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from acceptance.convert import to_elements
from softarm.estimator.errors import InputError
from softarm.estimator.geometry import Resolution, build_mesh
from softarm.estimator.geometry.checks import chamber_volume, element_volumes, jacobians
from softarm.estimator.geometry.faces import boundary_faces, open_edges
from softarm.estimator.mesh import ElementKind, Mesh
from softarm.estimator.specimen import (
    SHIPPED,
    Specimen,
    SweptLobes,
    load_specimen,
    parse_specimen,
    specimen_table,
)
from softarm.estimator.specimen.measures import (
    ArmMeasures,
    CylinderMeasures,
    SegmentMeasures,
    specimen_of_measures,
)


def cylinder_specimen(count: int) -> Specimen:
    """An arm of one segment with this many chambers."""
    shape = CylinderMeasures(count, outer_radius_m=0.018, wall_m=0.0025, core_radius_m=0.006)
    segments = (SegmentMeasures(0.1, 0.08, 0.01, 0.01),)
    return specimen_of_measures(
        ArmMeasures("cylinder", 0.008, segments, shape, 264e3, 1140e3, 1070.0, 50e3, wound=True)
    )


def volume(mesh: Mesh) -> float:
    return float(sum(element_volumes(mesh.points, block).sum() for block in mesh.blocks))


def segment_area(radius: float, distance: float) -> float:
    """Area of the part of a disc beyond a chord [m2]."""
    return radius**2 * np.arccos(distance / radius) - distance * np.sqrt(radius**2 - distance**2)


def integral(shape: SweptLobes, start: float, end: float, chambers: bool) -> float:
    """Integrate the cross-section's area, or one chamber's, along z [m3]."""
    heights = np.linspace(start, end, 20001)
    radii = np.interp(heights, shape.station_heights_m, shape.lobe_radii_m)
    if chambers:
        areas = segment_area(radii - shape.wall_m, shape.floor_m)
    else:
        areas = (np.sqrt(3.0) + 1.5 * np.pi) * radii**2
    return float(np.trapezoid(areas, heights))


@pytest.mark.parametrize("refinement", [1, 2])
def test_lobed_volumes_match_the_integral(refinement: int) -> None:
    specimen = load_specimen("sopra")
    assert isinstance(specimen.geometry, SweptLobes)
    mesh = build_mesh(specimen, Resolution(refinement=refinement))
    tolerance = 1e-3 / refinement**3
    holes = 0.0
    for chamber in specimen.chambers:
        exact = integral(specimen.geometry, chamber.from_m, chamber.to_m, chambers=True)
        assert chamber_volume(mesh, f"chamber_{chamber.index}") == pytest.approx(exact, rel=tolerance)
        holes += exact
    body = integral(specimen.geometry, 0.0, specimen.length_m, chambers=False) - holes
    assert volume(mesh) == pytest.approx(body, rel=tolerance)


def test_quadrant_volumes_match_the_plane_figures() -> None:
    specimen = load_specimen("single_segment")
    geometry = specimen.geometry
    assert geometry.kind == "quadrant_cylinder"
    mesh = build_mesh(specimen, Resolution(refinement=2))
    x = np.linspace(0.5 * geometry.wall_m, geometry.outer_radius_m - geometry.wall_m, 400001)
    inside = np.sqrt(np.maximum((geometry.outer_radius_m - geometry.wall_m) ** 2 - x**2, 0.0))
    low = np.maximum(0.5 * geometry.wall_m, geometry.core_m - x)
    area = float(np.trapezoid(np.maximum(inside - low, 0.0), x))
    chamber = specimen.chambers[0]
    exact = area * (chamber.to_m - chamber.from_m)
    for index in range(4):
        assert chamber_volume(mesh, f"chamber_{index}") == pytest.approx(exact, rel=1e-3)
    body = np.pi * geometry.outer_radius_m**2 * specimen.length_m - 4.0 * exact
    assert volume(mesh) == pytest.approx(body, rel=1e-3)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_cylinder_volumes_match_the_plane_figures(count: int) -> None:
    specimen = cylinder_specimen(count)
    geometry = specimen.geometry
    assert geometry.kind == "cylinder"
    mesh = build_mesh(specimen, Resolution(refinement=2))
    radii = np.linspace(geometry.core_radius_m, geometry.outer_radius_m - geometry.wall_m, 200001)
    angles = 2.0 * np.pi / count - 2.0 * np.arcsin(0.5 * geometry.wall_m / radii)
    exact = float(np.trapezoid(radii * angles, radii)) * 0.1
    for index in range(count):
        assert chamber_volume(mesh, f"chamber_{index}") == pytest.approx(exact, rel=1e-3)
    body = np.pi * geometry.outer_radius_m**2 * specimen.length_m - count * exact
    assert volume(mesh) == pytest.approx(body, rel=1e-3)
    assert jacobians(mesh.points, mesh.blocks[0]).min() > 0.0
    for number in range(count):
        nodes = mesh.points[np.unique(mesh.surfaces[f"chamber_{number}"].facets), :2]
        turn = 2.0 * np.pi * number / count
        middle = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
        assert middle @ [np.cos(turn), np.sin(turn)] > 0.8 * np.linalg.norm(middle)


def test_a_cylinder_with_too_few_chambers_or_no_room_for_them_is_refused() -> None:
    table = specimen_table(cylinder_specimen(3), Path())
    with pytest.raises(InputError, match="1 chamber where this cylinder has 2"):
        parse_specimen(tomli_w.dumps(table | {"chambers": table["chambers"][:1]}).encode(), "cylinder")
    table["geometry"]["core_radius_m"] = 0.017
    with pytest.raises(InputError, match=r"core radius 0\.017 m is not between"):
        parse_specimen(tomli_w.dumps(table).encode(), "cylinder")


def test_block_fills_its_box() -> None:
    mesh = build_mesh(load_specimen("beam"))
    assert volume(mesh) == pytest.approx(0.03 * 0.03 * 0.1, rel=1e-12)
    assert np.ptp(mesh.points, axis=0) == pytest.approx([0.03, 0.03, 0.1])


@pytest.mark.parametrize("name", SHIPPED)
def test_every_mesh_is_sound(name: str) -> None:
    specimen = load_specimen(name)
    mesh = build_mesh(specimen)
    assert mesh.regions == tuple(part.name for part in specimen.parts)
    block = mesh.blocks[0]
    assert jacobians(mesh.points, block).min() > 0.0
    assert np.unique(block.connectivity).size == len(mesh.points)
    surfaces = mesh.surfaces
    assert set(surfaces) == {f"chamber_{c.index}" for c in specimen.chambers} | {"outer"}
    everything = np.concatenate([surface.facets for surface in surfaces.values()])
    assert len(everything) == len(boundary_faces("hex20", block.connectivity))
    for surface in surfaces.values():
        assert len(open_edges(surface.kind, surface.facets)) == 0
    for section in specimen.sections:
        nodes = mesh.node_sets[f"section_{section.name}"]
        assert mesh.points[nodes, 2] == pytest.approx(section.frame_origin_m[2])
    assert (mesh.points[mesh.node_sets["clamp"], 2] <= specimen.clamp.up_to_m).all()


def test_chambers_are_images_of_one_another() -> None:
    specimen = load_specimen("sopra")
    mesh = build_mesh(specimen)
    turn = 2.0 * np.pi / 3.0
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    first = mesh.points[np.unique(mesh.surfaces["chamber_0"].facets)] @ rotation.T
    second = mesh.points[np.unique(mesh.surfaces["chamber_1"].facets)]
    gaps = np.linalg.norm(first[:, None] - second[None], axis=2).min(axis=1)
    assert gaps.max() < 1e-9
    centre = mesh.points[np.unique(mesh.surfaces["chamber_0"].facets)].mean(axis=0)
    assert centre[0] > 0.01
    assert abs(centre[1]) < 1e-9


def test_the_default_keeps_its_size() -> None:
    mesh = build_mesh(load_specimen("sopra"))
    assert 1000 <= len(mesh.points) <= 1300
    assert 150 <= len(mesh.blocks[0].connectivity) <= 220


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10"])
def test_converted_meshes_fill_the_same_body(kind: ElementKind) -> None:
    specimen = load_specimen("sopra")
    fine = build_mesh(specimen, Resolution(layers=4))
    mesh = to_elements(fine, kind)
    assert jacobians(mesh.points, mesh.blocks[0]).min() > 0.0
    assert np.unique(mesh.blocks[0].connectivity).size == len(mesh.points)
    assert volume(mesh) == pytest.approx(volume(fine), rel=1e-6 if kind == "tet10" else 0.07)
    everything = np.concatenate([surface.facets for surface in mesh.surfaces.values()])
    assert len(everything) == len(boundary_faces(kind, mesh.blocks[0].connectivity))
    for name, surface in mesh.surfaces.items():
        assert len(open_edges(surface.kind, surface.facets)) == 0
        if name != "outer":
            assert chamber_volume(mesh, name) == pytest.approx(chamber_volume(fine, name), rel=0.1)
    assert all(len(nodes) >= 3 for nodes in mesh.node_sets.values())


@settings(max_examples=8, deadline=None)
@given(
    radius=st.floats(0.0125, 0.05),
    taper=st.floats(0.5, 1.5),
    wall=st.floats(0.0005, 0.002),
    floor=st.floats(0.0005, 0.002),
    azimuth=st.floats(-2.0, 2.0),
)
def test_any_lobed_body_is_sound(
    radius: float, taper: float, wall: float, floor: float, azimuth: float
) -> None:
    specimen = load_specimen("sopra")
    table = specimen_table(specimen, specimen.folder)
    shape = specimen.geometry.model_copy(
        update={
            "station_heights_m": (0.0, 0.276),
            "lobe_radii_m": (radius, radius * taper),
            "wall_m": wall,
            "floor_m": floor,
        }
    )
    chambers = [
        chamber.model_copy(update={"azimuth_rad": chamber.azimuth_rad + azimuth})
        for chamber in specimen.chambers
    ]
    table["geometry"] = shape.model_dump()
    table["chambers"] = [chamber.model_dump() for chamber in chambers]
    changed = Specimen.model_validate(table)
    assert isinstance(changed.geometry, SweptLobes)
    mesh = build_mesh(changed)
    exact = integral(changed.geometry, 0.010, 0.130, chambers=True)
    assert chamber_volume(mesh, "chamber_0") == pytest.approx(exact, rel=3e-3)


def test_chambers_out_of_line_are_refused() -> None:
    specimen = load_specimen("sopra")
    table = specimen_table(specimen, specimen.folder)
    chambers = [dict(chamber.model_dump()) for chamber in specimen.chambers]
    for chamber in chambers[3:]:
        chamber["azimuth_rad"] += 0.5
    twisted = parse_specimen(tomli_w.dumps(table | {"chambers": chambers}).encode(), "arm.toml")
    with pytest.raises(InputError, match=r"chambers\[3\].azimuth_rad: .* not in line"):
        build_mesh(twisted)
