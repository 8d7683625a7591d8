"""The model of a specimen: masses, stiffness, fibres, loads, and what calibration changes."""

import numpy as np
import pytest

from softarm.estimator.arm import build_arm, default_loads, fibres, region_materials
from softarm.estimator.fem import FiniteElementModel, Membrane, Springs
from softarm.estimator.geometry import Resolution, build_mesh
from softarm.estimator.model import Inputs
from softarm.estimator.specimen import SHIPPED, Calibration, Fibres, Value, load_specimen


@pytest.fixture(scope="module")
def arm() -> FiniteElementModel:
    return build_arm(load_specimen("sopra"))


def test_names_are_those_of_the_specimen(arm: FiniteElementModel) -> None:
    assert arm.sections == ("base", "intermediate", "tip")
    assert arm.chambers == 6
    assert [load.name for load in arm.loads] == ["intermediate_x", "intermediate_y", "tip_x", "tip_y"]
    assert {"upper", "lower"} < set(arm.parameters)


def test_frames_at_rest_are_those_of_the_specimen(arm: FiniteElementModel) -> None:
    specimen = load_specimen("sopra")
    frames = arm.section_frames(arm.rest())
    origins = [section.frame_origin_m for section in specimen.sections]
    np.testing.assert_allclose(frames.positions, origins, atol=1e-12)
    np.testing.assert_allclose(frames.rotations, np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-9)


def test_weighed_parts_keep_their_mass(arm: FiniteElementModel) -> None:
    specimen = load_specimen("sopra")
    mesh = build_mesh(specimen)
    weighed = sum(part.mass_kg or 0.0 for part in specimen.parts)
    held = specimen.materials["shore_30a"].density_kg_m3
    base = np.pi * 1.5 * 0.0175**2 + np.sqrt(3.0) * 0.0175**2
    assert arm.nodal_mass.sum() == pytest.approx(weighed + held * base * 0.010, rel=1e-4)
    materials = region_materials(specimen, mesh)
    assert materials["upper"].shear_modulus == pytest.approx(88600.0)
    assert materials["upper"].density > 1070.0


def test_each_chamber_bends_the_arm_away_from_itself(arm: FiniteElementModel) -> None:
    specimen = load_specimen("sopra")
    step = arm.linearise(arm.rest(), arm.no_inputs())
    _, change = step.response(np.eye(18))
    for chamber in specimen.chambers:
        tip = change[12:14, chamber.index]
        away = -np.array([np.cos(chamber.azimuth_rad), np.sin(chamber.azimuth_rad)])
        assert tip @ away == pytest.approx(np.linalg.norm(tip), rel=1e-3)


def test_the_modulus_scale_of_calibration_acts() -> None:
    specimen = load_specimen("beam")
    scaled = specimen.model_copy(
        update={"calibration": Calibration(modulus_scale={"upper": Value(value=2.0)})}
    )
    deflections = []
    for each in (specimen, scaled):
        model = build_arm(each)
        force = Inputs(np.zeros(0), np.array([1e-3, 0.0]), np.zeros(3))
        state, converged = model.solve(force, model.rest())
        assert converged
        deflections.append(model.section_frames(state).positions[1, 0])
    assert deflections[0] == pytest.approx(2.0 * deflections[1], rel=1e-4)


def test_a_slender_beam_sags_as_a_beam() -> None:
    """Timoshenko's cantilever under its own weight: w L^4 / 8EI + w L^2 / 2kGA, k = 5/6."""
    specimen = load_specimen("beam")
    width, share = 0.0075, 1e-3
    thin = specimen.geometry.model_copy(update={"width_x_m": width, "width_y_m": width})
    model = build_arm(specimen.model_copy(update={"geometry": thin}), resolution=Resolution(layers=16))
    gravity = share * np.array(specimen.gravity_m_s2)
    state, converged = model.solve(Inputs(np.zeros(0), np.zeros(2), gravity), model.rest())
    assert converged
    weight = 1070.0 * 9.81 * share * width**2
    modulus, shear, inertia = 2 * 88600.0 * 1.49, 88600.0, width**4 / 12
    expected = weight * (0.1**4 / (8 * modulus * inertia) + 0.1**2 / (2 * shear * width**2 * 5 / 6))
    sag = -model.section_frames(state).positions[1, 0]
    assert sag == pytest.approx(expected, rel=0.03)


def test_springs_lie_on_the_walls_of_their_chamber() -> None:
    specimen = load_specimen("sopra")
    springs = Fibres(kind="springs", spring_stiffness_n_m=1e4, rings_per_chamber=5, bars_per_ring=16)
    wound = specimen.model_copy(update={"fibres": springs})
    mesh = build_mesh(wound)
    for entry, chamber in zip(fibres(wound, mesh), wound.chambers, strict=True):
        assert isinstance(entry, Springs)
        assert entry.first.shape == (80, 3)
        np.testing.assert_array_equal(np.sort(entry.first, axis=0), np.sort(entry.second, axis=0))
        assert (entry.first[:, 2] > chamber.from_m).all()
        assert (entry.first[:, 2] < chamber.to_m).all()
        rings = entry.first.reshape(5, 16, 3)
        lengths = np.linalg.norm(entry.second - entry.first, axis=1).reshape(5, 16)
        radius = np.interp(
            rings[:, 0, 2], [0.01, 0.13, 0.151, 0.271], [0.0155, 0.0155 - 0.0035, 0.012, 0.0079]
        )
        edge = np.arcsin(0.002 / radius)
        perimeter = radius * (np.pi - 2 * edge) + 2 * radius * np.cos(edge)
        np.testing.assert_allclose(lengths.sum(axis=1), perimeter, rtol=0.05)
    model = build_arm(wound)
    assert model.chambers == 6


def test_membranes_cover_every_chamber() -> None:
    specimen = load_specimen("sopra")
    found = fibres(specimen, build_mesh(specimen))
    assert [entry.surface for entry in found if isinstance(entry, Membrane)] == [
        f"chamber_{k}" for k in range(6)
    ]


@pytest.mark.parametrize("name", SHIPPED)
def test_loads_leave_out_what_is_held(name: str) -> None:
    specimen = load_specimen(name)
    assert all(load.section != "base" for load in default_loads(specimen))
    assert {load.section for load in default_loads(specimen)} >= {"tip"}
