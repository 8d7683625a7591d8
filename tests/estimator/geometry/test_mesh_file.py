"""Meshes from files: every format's groups, and every error in a file named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from acceptance.convert import to_elements
from softarm.estimator.errors import InputError
from softarm.estimator.geometry import Resolution, build_mesh
from softarm.estimator.geometry.checks import chamber_volume, element_volumes
from softarm.estimator.mesh import ElementKind, Mesh
from softarm.estimator.specimen import Specimen, load_specimen, specimen_table

CELLS = {"hex20": "hexahedron20", "hex8": "hexahedron", "tet4": "tetra", "tet10": "tetra10"}
FACETS = {"hex20": "quad8", "hex8": "quad", "tet4": "triangle", "tet10": "triangle6"}


@pytest.fixture(scope="module")
def arm() -> Mesh:
    return build_mesh(load_specimen("single_segment"))


def from_file(path: Path, **fields: Any) -> Specimen:
    """Describe the one-segment arm with a mesh from a file."""
    table = specimen_table(load_specimen("single_segment"), Path())
    geometry = {"kind": "mesh_file", "path": path.name, **fields}
    return Specimen.model_validate({**table, "geometry": geometry}).placed_in(path.parent)


def grouped(mesh: Mesh, kind: ElementKind) -> meshio.Mesh:
    """Write regions, chambers and clamp as cell and point sets."""
    block = mesh.blocks[0]
    walls = {k: s for k, s in mesh.surfaces.items() if k != "outer"}
    flip = -1 if kind == "tet4" else 1
    cells = [(CELLS[kind], block.connectivity)]
    cells += [(FACETS[kind], surface.facets[:, ::flip]) for surface in walls.values()]
    sets: dict[str, list[Any]] = {}
    for index, name in enumerate(mesh.regions):
        sets[f"part_{name}"] = [np.flatnonzero(block.region == index)]
    count = len(cells)
    for group in sets.values():
        group += [np.empty(0, dtype=int)] * (count - 1)
    for position, (name, surface) in enumerate(walls.items(), start=1):
        sets[f"wall_{name}"] = [np.empty(0, dtype=int)] * count
        sets[f"wall_{name}"][position] = np.arange(len(surface.facets))
    points = np.vstack([mesh.points, [[9.0, 9.0, 9.0]]])
    return meshio.Mesh(points, cells, cell_sets=sets, point_sets={"held": mesh.node_sets["clamp"]})


def groups(mesh: Mesh) -> dict[str, Any]:
    return {
        "regions": {name: f"part_{name}" for name in mesh.regions},
        "chamber_surfaces": {str(k): f"wall_chamber_{k}" for k in range(4)},
        "clamp": "held",
    }


def stored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: meshio.Mesh) -> Path:
    """Let a file hold exactly this content, whatever its format could keep."""
    path = tmp_path / "arm.vtk"
    path.touch()
    monkeypatch.setattr(meshio, "read", lambda _: content)
    return path


@pytest.mark.parametrize("kind", ["hex20", "hex8", "tet4", "tet10"])
def test_named_groups(arm: Mesh, kind: ElementKind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = to_elements(arm, kind)
    path = stored(monkeypatch, tmp_path, grouped(original, kind))
    mesh = build_mesh(from_file(path, **groups(arm)))
    assert len(mesh.points) == len(original.points)
    np.testing.assert_array_equal(mesh.blocks[0].region, original.blocks[0].region)
    np.testing.assert_array_equal(mesh.node_sets["clamp"], original.node_sets["clamp"])
    for k in range(4):
        name = f"chamber_{k}"
        assert chamber_volume(mesh, name) == pytest.approx(chamber_volume(original, name))


@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".msh"])
def test_a_bare_file_is_divided_by_heights(arm: Mesh, suffix: str, tmp_path: Path) -> None:
    block = arm.blocks[0]
    turned = arm.points[:, [0, 1, 2]] * np.array([1.0, -1.0, -1.0]) * 1000.0
    path = tmp_path / f"arm{suffix}"
    form = {".msh": "gmsh22", ".vtk": "vtk", ".vtu": "vtu"}[suffix]
    meshio.write_points_cells(path, turned, [("hexahedron20", block.connectivity)], file_format=form)
    mesh = build_mesh(from_file(path, metres_per_unit=0.001, quaternion=[0.0, 1.0, 0.0, 0.0]))
    np.testing.assert_allclose(mesh.points, arm.points, atol=1e-12)
    np.testing.assert_array_equal(mesh.blocks[0].region, block.region)
    for name in ("chamber_0", "chamber_3"):
        assert chamber_volume(mesh, name) == pytest.approx(chamber_volume(arm, name))
        assert set(mesh.surfaces[name].facets.ravel()) == set(arm.surfaces[name].facets.ravel())
    assert element_volumes(mesh.points, mesh.blocks[0]).sum() == pytest.approx(
        element_volumes(arm.points, block).sum()
    )


def test_gmsh_physical_groups(arm: Mesh, tmp_path: Path) -> None:
    block = arm.blocks[0]
    walls = [arm.surfaces[f"chamber_{k}"].facets for k in range(4)]
    tags = [1 + block.region, *(np.full(len(wall), 10 + k) for k, wall in enumerate(walls))]
    content = meshio.Mesh(
        arm.points,
        [("hexahedron20", block.connectivity), *(("quad8", wall) for wall in walls)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": [tag.copy() for tag in tags]},
        field_data={
            **{f"part_{name}": np.array([1 + k, 3]) for k, name in enumerate(arm.regions)},
            **{f"wall_chamber_{k}": np.array([10 + k, 2]) for k in range(4)},
        },
    )
    path = tmp_path / "arm.msh"
    content.write(path, file_format="gmsh22")
    fields = {key: value for key, value in groups(arm).items() if key != "clamp"}
    mesh = build_mesh(from_file(path, **fields))
    np.testing.assert_array_equal(mesh.blocks[0].region, block.region)
    np.testing.assert_array_equal(np.sort(mesh.node_sets["clamp"]), np.sort(arm.node_sets["clamp"]))
    with pytest.raises(InputError, match=r"no group 'held'.*part_base") as refused:
        build_mesh(from_file(path, **fields, clamp="held"))
    assert "gmsh:" not in str(refused.value)


def test_groups_by_integer_in_a_data_array(arm: Mesh, tmp_path: Path) -> None:
    block = arm.blocks[0]
    path = tmp_path / "arm.vtu"
    meshio.Mesh(
        arm.points, [("hexahedron20", block.connectivity)], cell_data={"part": [block.region + 1]}
    ).write(path)
    names = {name: f"part={k + 1}" for k, name in enumerate(arm.regions)}
    mesh = build_mesh(from_file(path, regions=names))
    np.testing.assert_array_equal(mesh.blocks[0].region, block.region)


def drop_wall_facet(content: meshio.Mesh, _: dict[str, Any]) -> None:
    content.cell_sets["wall_chamber_2"][3] = content.cell_sets["wall_chamber_2"][3][1:]


def invert_element(content: meshio.Mesh, _: dict[str, Any]) -> None:
    mirrored = [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19]
    content.cells[0].data[0] = content.cells[0].data[0][mirrored]


def misspell(_: meshio.Mesh, fields: dict[str, Any]) -> None:
    fields["regions"]["tip"] = "part_tp"


def empty_wall(content: meshio.Mesh, _: dict[str, Any]) -> None:
    content.cell_sets["wall_chamber_1"][2] = np.empty(0, dtype=int)


def forget_wall(_: meshio.Mesh, fields: dict[str, Any]) -> None:
    del fields["chamber_surfaces"]["3"]


def wall_inside(content: meshio.Mesh, _: dict[str, Any]) -> None:
    inside = content.cells[0].data[100][[0, 3, 2, 1, 11, 10, 9, 8]]
    content.cells[1].data[0] = inside


def lose_elements(content: meshio.Mesh, _: dict[str, Any]) -> None:
    content.cell_sets["part_upper"][0] = content.cell_sets["part_upper"][0][5:]


def not_finite(content: meshio.Mesh, _: dict[str, Any]) -> None:
    content.points[5, 1] = np.nan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (drop_wall_facet, r"chamber_2 is open .* at 4 edges.*close the chamber with end caps"),
        (invert_element, r"geometry.path: 1 of \d+ hex20 elements are inverted"),
        (misspell, r"geometry.regions.tip: no group 'part_tp'.*did you mean 'part_tip'"),
        (empty_wall, r"geometry.chamber_surfaces.1: group 'wall_chamber_1' .* holds no facets"),
        (forget_wall, r"geometry.chamber_surfaces.3: missing"),
        (wall_inside, r"geometry.chamber_surfaces.0: 1 of \d+ facets are not on the body's surface"),
        (lose_elements, r"geometry.regions: 5 elements are in no part's group"),
        (not_finite, r"a node's coordinate is not finite"),
    ],
)
def test_mistakes_are_named(
    arm: Mesh,
    change: Callable[[meshio.Mesh, dict[str, Any]], None],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = grouped(arm, "hex20")
    content.cells[0].data = content.cells[0].data.copy()
    fields = groups(arm)
    change(content, fields)
    path = stored(monkeypatch, tmp_path, content)
    with pytest.raises(InputError, match=message) as caught:
        build_mesh(from_file(path, **fields))
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_solid_body_has_no_chamber(tmp_path: Path) -> None:
    beam = build_mesh(load_specimen("beam"), Resolution(layers=60))
    path = tmp_path / "beam.vtk"
    points = beam.points * np.array([1.0, 1.0, 1.02])
    meshio.write_points_cells(path, points, [("hexahedron20", beam.blocks[0].connectivity)])
    with pytest.raises(InputError, match=r"no closed inner surface .*0 inner surfaces"):
        build_mesh(from_file(path))


def test_a_section_outside_the_mesh(tmp_path: Path) -> None:
    beam = build_mesh(load_specimen("beam"))
    path = tmp_path / "beam.vtk"
    meshio.write_points_cells(path, beam.points * 0.5, [("hexahedron20", beam.blocks[0].connectivity)])
    table = specimen_table(load_specimen("beam"), tmp_path)
    geometry = {"kind": "mesh_file", "path": path.name}
    specimen = Specimen.model_validate({**table, "geometry": geometry}).placed_in(tmp_path)
    with pytest.raises(
        InputError, match=r"sections.tip: 0.1 to 0.1 m holds fewer than 3 of the mesh's nodes"
    ):
        build_mesh(specimen)


@pytest.mark.parametrize(
    ("text", "message"), [(None, "no such mesh file"), ("nonsense", r"cannot read the mesh: .*arm\.vtk as")]
)
def test_unreadable_files(
    text: str | None, message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.vtk"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message):
        build_mesh(from_file(path))
    assert capfd.readouterr() == ("", "")
