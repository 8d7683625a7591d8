"""The ratio is 1 where readings err as stated; common errors raise it, unless they grow with the pull."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, stdtrit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.force_accuracy import ForceAccuracy, force_accuracy
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulled_moduli import by_pull
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing import ActuationMap, Orientation, SensorSuite

NODES = 400
TIP = "vented pulls on tip"
SCATTER = {"frame_upper rotation": 0.01, "frame_tip rotation": 0.02}
SUITE = SensorSuite((Orientation("frame_upper", 0, 1e-3), Orientation("frame_tip", 1, 1e-3)))
RNG = np.random.default_rng(3)
TO_FORCES = RNG.normal(size=(12, 6))
TO_PRESSURES = 1e-6 * RNG.normal(size=(12, 2))
NAMES = tuple(f"{section}_{axis}" for section in ("upper", "tip") for axis in "xyz")
ROTATIONS = np.r_[3:6, 9:12]


def accuracy(
    innovation: Floats,
    pulls: Floats,
    pressure: float = 0.0,
    weights: Floats | None = None,
    blocks: Indices | None = None,
) -> ForceAccuracy:
    count = len(innovation)
    frames = Frames(np.zeros((count, 2, 3)), np.broadcast_to(np.eye(3), (count, 2, 3, 3)))
    jacobian = np.broadcast_to(np.hstack([TO_PRESSURES, TO_FORCES, np.zeros((12, 3))]), (count, 12, 11))
    response = ArmResponse(frames, np.ones(count, dtype=bool), 2, jacobian)
    time, pressures = np.arange(float(count)), np.full((count, 2), pressure)
    readings = np.tile([1.0, 0.0, 0.0, 0.0], (count, 2))
    run = CalibrationRun("run", time, pressures, ("measured",) * 2, SUITE, readings, pulls, NAMES)
    weights = np.ones(count) if weights is None else weights
    blocks = np.arange(count) // 8 if blocks is None else blocks
    nodes = Nodes(run, time, pressures, readings, pulls, weights, blocks)
    at = NodePredictions(innovation, np.zeros((count, 6, 0)), np.zeros((count, 6, 6)), response)
    setting = Setting({}, ActuationMap(np.ones(2), np.zeros(2)))
    return force_accuracy(setting, [at], [nodes], SCATTER)


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
    found = accuracy(noise(), pulls_on(section, (0.3, -0.2, 0.0)), pressure)
    assert list(found.errors) == [f"{name} on {('upper', 'tip')[section]}"]
    # The readings err no other way where a force on the other section is estimated.
    assert found.ratios == {f"{name} on {other}": pytest.approx(1.0, abs=0.1) for other in ("upper", "tip")}


def test_an_axial_pull_is_not_known_to_the_estimate() -> None:
    """What it is taken for grows with the pull."""
    plain, axial = (accuracy(noise(), pulls_on(1, (0.3, 0.0, z))).errors[TIP] for z in (0.0, 0.3))
    assert axial > 2.0 * plain


@pytest.mark.parametrize("share", [(0.02, 0.0), (0.0, 0.02)], ids=["along", "across"])
def test_an_error_that_grows_with_the_pull_does_not_count_at_small_ones(share: tuple[float, float]) -> None:
    along, across = share
    pulls = np.linspace(0.1, 5.0, NODES)[:, None] * pulls_on(1, (0.6, 0.8, 0.0))
    grown = along * pulls[:, 3:5] + across * np.column_stack([-pulls[:, 4], pulls[:, 3]])
    found = accuracy(noise() + grown @ TO_FORCES[ROTATIONS, 3:5].T, pulls)
    assert found.ratios[TIP] == pytest.approx(1.0, abs=0.1)
    assert found.errors[TIP] == pytest.approx(0.02 / np.sqrt(2.0), rel=0.1)  # of each of two components


def test_the_fewer_the_pulls_the_less_certain_is_by_what_they_differ() -> None:
    """Errors of the forces in pulls that nobody has seen lie within two deviations in 95 of 100 cases."""
    blocks, inside = np.repeat(np.arange(3), 4), []
    pulls = np.tile([0.5, 1.0, 1.5, 2.0], 3)[:, None] * pulls_on(1, (1.0, 0.0, 0.0), 12)
    for _ in range(300):
        share = 0.1 * RNG.normal(size=(4, 2))
        grown = pulls[:, 3, None] * share[blocks]
        found = accuracy(grown @ TO_FORCES[ROTATIONS, 3:5].T, pulls, blocks=blocks)
        inside += (np.abs(share[3]) < 2.0 * found.errors[TIP]).tolist()
    assert np.mean(inside) == pytest.approx(0.9545, abs=0.02)
    few, many = (
        accuracy(noise(), pulls_on(1, (1.0, 0.0, 0.0)), blocks=np.arange(NODES) // n) for n in (200, 4)
    )
    assert few.ratios[TIP] == pytest.approx(0.5 * stdtrit(4, ndtr(2.0)) * many.ratios[TIP], rel=0.1)


def test_readings_that_err_together_like_a_force_give_more() -> None:
    together = 0.1 * RNG.normal(size=(NODES, 1)) * TO_FORCES[ROTATIONS, 3]
    assert accuracy(noise() + together, pulls_on(1, (0.3, 0.0, 0.0))).ratios[TIP] > 2.0


def test_nodes_at_which_the_arm_moves_count_little() -> None:
    moving = np.arange(NODES) % 4 == 0
    shaken = noise() + 0.3 * moving[:, None] * RNG.normal(size=(NODES, 6))
    found = accuracy(shaken, pulls_on(1, (0.3, 0.0, 0.0)), weights=np.where(moving, 1e-6, 1.0))
    assert found.ratios[TIP] == pytest.approx(1.0, abs=0.1)


def test_nothing_is_told_without_pulls_or_readings() -> None:
    nothing = ForceAccuracy({}, {})
    assert accuracy(noise(), pulls_on(1, (0.0, 0.0, 0.0))) == nothing
    assert accuracy(np.full((NODES, 6), np.nan), pulls_on(1, (0.3, 0.0, 0.0))) == nothing
    assert accuracy(noise(), pulls_on(1, (0.0, 0.0, 0.3))) == nothing


def test_one_node_does_not_tell_noise_from_what_grows_with_the_pull() -> None:
    found = accuracy(noise()[:1], pulls_on(1, (0.3, 0.0, 0.0), 1))
    assert found.ratios == {}
    assert list(found.errors) == [TIP]


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
