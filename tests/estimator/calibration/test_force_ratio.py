"""The force ratio is 1 where readings err as told, and what they err together shows in it."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.force_ratio import force_ratios
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulled_moduli import by_pull
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing import ActuationMap, Orientation, SensorSuite

NODES = 400
SCATTER = {"frame_upper rotation": 0.01, "frame_tip rotation": 0.02}
SUITE = SensorSuite((Orientation("frame_upper", 0, 1e-3), Orientation("frame_tip", 1, 1e-3)))
RNG = np.random.default_rng(3)
TO_FORCES = RNG.normal(size=(12, 6))
TO_PRESSURES = 1e-6 * RNG.normal(size=(12, 2))
NAMES = tuple(f"{section}_{axis}" for section in ("upper", "tip") for axis in "xyz")
ROTATIONS = np.r_[3:6, 9:12]


def ratios(
    innovation: Floats, pulls: Floats, pressure: float = 0.0, weights: Floats | None = None
) -> dict[str, float]:
    count = len(innovation)
    frames = Frames(np.zeros((count, 2, 3)), np.broadcast_to(np.eye(3), (count, 2, 3, 3)))
    jacobian = np.broadcast_to(np.hstack([TO_PRESSURES, TO_FORCES, np.zeros((12, 3))]), (count, 12, 11))
    response = ArmResponse(frames, np.ones(count, dtype=bool), 2, jacobian)
    time, pressures = np.arange(float(count)), np.full((count, 2), pressure)
    readings = np.tile([1.0, 0.0, 0.0, 0.0], (count, 2))
    run = CalibrationRun("run", time, pressures, ("measured",) * 2, SUITE, readings, pulls, NAMES)
    weights = np.ones(count) if weights is None else weights
    nodes = Nodes(run, time, pressures, readings, pulls, weights, np.zeros(count, dtype=np.int64))
    at = NodePredictions(innovation, np.zeros((count, 6, 0)), np.zeros((count, 6, 6)), response)
    setting = Setting({}, ActuationMap(np.ones(2), np.zeros(2)))
    return force_ratios(setting, [at], [nodes], SCATTER)


def pulls_on(section: int, force: tuple[float, float, float], count: int = NODES) -> Floats:
    pulls = np.zeros((count, 6))
    pulls[:, 3 * section : 3 * section + 3] = force
    return pulls


def noise() -> Floats:
    own = np.hypot(1e-3, np.repeat([0.01, 0.02], 3)) * RNG.normal(size=(NODES, 6))
    return own + (200.0 * RNG.normal(size=(NODES, 2))) @ TO_PRESSURES[ROTATIONS].T


@pytest.mark.parametrize(("pressure", "name"), [(0.0, "vented pulls"), (2e4, "pressurised pulls")])
@pytest.mark.parametrize("section", [0, 1])
def test_readings_that_err_as_told_give_one(section: int, pressure: float, name: str) -> None:
    found = ratios(noise(), pulls_on(section, (0.3, -0.2, 0.0)), pressure)
    pulled = f"{name} on {('upper', 'tip')[section]}"
    assert list(found) == [pulled]
    assert found[pulled] == pytest.approx(1.0, abs=0.1)


def test_an_axial_pull_is_not_known_to_the_estimate() -> None:
    plain, axial = (ratios(noise(), pulls_on(1, (0.3, 0.0, z)))["vented pulls on tip"] for z in (0.0, 0.3))
    assert axial > 2.0 * plain


def test_readings_that_err_together_like_a_force_give_more() -> None:
    together = 0.1 * RNG.normal(size=(NODES, 1)) * TO_FORCES[ROTATIONS, 3]
    assert ratios(noise() + together, pulls_on(1, (0.3, 0.0, 0.0)))["vented pulls on tip"] > 2.0


def test_nodes_at_which_the_arm_moves_count_little() -> None:
    moving = np.arange(NODES) % 4 == 0
    shaken = noise() + 0.3 * moving[:, None] * RNG.normal(size=(NODES, 6))
    found = ratios(shaken, pulls_on(1, (0.3, 0.0, 0.0)), weights=np.where(moving, 1e-6, 1.0))
    assert found["vented pulls on tip"] == pytest.approx(1.0, abs=0.1)


def test_nothing_is_told_without_pulls_or_readings() -> None:
    assert ratios(noise(), pulls_on(1, (0.0, 0.0, 0.0))) == {}
    assert ratios(np.full((NODES, 6), np.nan), pulls_on(1, (0.3, 0.0, 0.0))) == {}


def test_a_pull_is_one_block_from_slack_to_slack() -> None:
    tension = np.array([0.0, 0.1, 0.3, 0.5, 0.01, 0.2, 0.4, 0.0])
    pulls = tension[:, None] * np.eye(6)[3]
    time, readings = np.arange(8.0), np.tile([1.0, 0.0, 0.0, 0.0], (8, 2))
    pressures, blocks = np.zeros((8, 2)), np.array([0, 0, 0, 0, 1, 1, 1, 1])
    run = CalibrationRun("run", time, pressures, ("measured",) * 2, SUITE, readings, pulls, NAMES)
    nodes = Nodes(run, time, pressures, readings, pulls, np.ones(8), blocks)
    np.testing.assert_array_equal(by_pull(nodes).blocks, [0, 1, 1, 1, 1, 2, 2, 2])
    free = replace(nodes, run=replace(run, loads=np.zeros((8, 6))))
    np.testing.assert_array_equal(by_pull(free).blocks, blocks)
