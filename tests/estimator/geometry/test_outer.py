"""How far bodies reach from their axis."""

from pathlib import Path

import numpy as np
import pytest

from softarm.estimator.geometry import build_mesh
from softarm.estimator.geometry.outer import outer_radii
from softarm.estimator.specimen import load_specimen
from tests.estimator.geometry.test_mesh_file import from_file, grouped, groups, stored


@pytest.mark.parametrize("name", ["sopra", "single_segment", "beam"])
def test_the_outer_radius_is_that_of_the_outermost_nodes(name: str) -> None:
    specimen = load_specimen(name)
    points = build_mesh(specimen).points
    for section in specimen.sections:
        at = 0.5 * (section.from_m + section.to_m)
        near = np.abs(points[:, 2] - at) <= 0.5 * (section.to_m - section.from_m) + 1e-9
        reach = float(np.hypot(*points[near, :2].T).max())
        assert outer_radii(specimen, np.array([at]))[0] == pytest.approx(reach, rel=0.03)


def test_a_mesh_from_a_file_reaches_as_far_as_the_body_it_was_made_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = load_specimen("single_segment")
    mesh = build_mesh(drawn)
    path = stored(monkeypatch, tmp_path, grouped(mesh, "hex20"))
    read = from_file(path, **groups(mesh))
    heights = np.linspace(drawn.sections[0].from_m, drawn.sections[-1].to_m, 7)
    assert outer_radii(read, heights) == pytest.approx(outer_radii(drawn, heights), rel=0.02)
