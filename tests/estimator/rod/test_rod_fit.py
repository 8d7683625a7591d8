"""Files of rods, their keys, and the motion of the finite elements that they are fitted to."""

import numpy as np
import pytest

from softarm.common.shipped import fake_specimen
from softarm.estimator.arm import build_arm
from softarm.estimator.model import Inputs
from softarm.estimator.rod import Recipe, shape_key
from softarm.estimator.rod.archive import from_bytes
from softarm.estimator.rod.load_stiffness import exact_moves
from softarm.estimator.rod.samples import SamplingPlan, sampling_loads
from softarm.estimator.rod.stations import cut
from softarm.estimator.specimen import load_specimen

SMALL = Recipe(plan=SamplingPlan(rays=6), check=SamplingPlan(rays=2, seed=101, pressure=1.0))


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 cut off", b"\x93NUMPY", bytes(200)])
def test_a_damaged_file_holds_no_rod(data) -> None:
    assert from_bytes(data) is None


def test_the_key_follows_the_shape_and_nothing_else() -> None:
    sopra = load_specimen("sopra")
    key = shape_key(sopra)
    turned = sopra.model_copy(update={"gravity_m_s2": (9.81, 0.0, 0.0), "name": "mine"})
    assert shape_key(turned) == key
    assert shape_key(load_specimen(fake_specimen())) == key
    thicker = sopra.geometry.model_copy(update={"wall_m": 0.0021})
    assert shape_key(sopra.model_copy(update={"geometry": thicker})) != key
    heavier = sopra.segments[0].model_copy(update={"mass_kg": 0.2})
    assert shape_key(sopra.model_copy(update={"segments": (heavier, *sopra.segments[1:])})) != key
    assert shape_key(sopra, SMALL) != key


def test_turning_loads_count_in_the_motion_of_the_finite_elements() -> None:
    specimen = load_specimen("beam")
    model = build_arm(specimen, sampling_loads(specimen))
    stations = cut(specimen, model)
    loads = np.array([0.1, 0.0, 0.0, 0.0, 0.05, 0.02])
    gravity = np.array(specimen.gravity_m_s2)
    state, found = model.solve(Inputs(np.zeros(0), loads, gravity), model.rest())
    assert found
    step = model.linearise(state, Inputs(np.zeros(0), loads, gravity))
    assert step.factor is not None
    nodal = step.balance.load_vectors
    moves = exact_moves(model, step.factor, state.displacement, loads, nodal)
    assert moves is not None
    twists = stations.poses(model.body.points + state.displacement, moves)[2]
    for column, size in ((0, 1e-3), (4, 1e-4)):
        ends = []
        for sign in (1.0, -1.0):
            moved = loads.copy()
            moved[column] += sign * size
            near, found = model.solve(Inputs(np.zeros(0), moved, gravity), state)
            assert found
            ends.append(stations.poses(model.body.points + near.displacement, nodal[:0])[0])
        numeric = (ends[0] - ends[1]) / (2.0 * size)
        assert np.abs(numeric - twists[:, :3, column]).max() < 1e-3 * np.abs(numeric).max()


def test_the_stations_of_an_arm_at_rest_lie_on_its_axis() -> None:
    specimen = load_specimen("single_segment")
    model = build_arm(specimen, sampling_loads(specimen))
    stations = cut(specimen, model)
    none = np.zeros((0, *model.body.points.shape))
    origins, rotations, _ = stations.poses(model.body.points, none)
    assert np.abs(origins[:, :2]).max() < 1e-9
    assert origins[:, 2] == pytest.approx(stations.chain.heights[1:], abs=1e-9)
    assert np.allclose(rotations, np.eye(3), atol=1e-9)
