"""What readings keep of a pull is found as a share of it; torsion under pressure is that of free poses."""

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.force_memory import force_memory_shares
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulled_moduli import by_pull
from softarm.estimator.calibration.scatter import scatter_by_condition
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing import ActuationMap, MeasuredPose, SensorSuite
from softarm.estimator.specimen import Value

NAMES = ("tip_x", "tip_y", "tip_z")
SUITE = SensorSuite((MeasuredPose("frame_tip", 0, 1e-3, 1e-3),))
TO_FORCES = np.random.default_rng(4).normal(size=(6, 3))
SETTING = Setting({}, ActuationMap(np.ones(2), np.zeros(2)))
PULLS = np.tile([0.0, 0.2, 0.5, 0.4], 4)[:-1, None] * np.array([0.6, 0.8, 0.0])
"""Slack, three nodes taut, and so on; slack at the end."""


def run_of(pulls: Floats, innovation: Floats, pressure: float = 0.0) -> tuple[NodePredictions, Nodes]:
    count = len(pulls)
    frames = Frames(np.zeros((count, 1, 3)), np.broadcast_to(np.eye(3), (count, 1, 3, 3)))
    jacobian = np.broadcast_to(np.hstack([np.zeros((6, 2)), TO_FORCES, np.zeros((6, 3))]), (count, 6, 8))
    response = ArmResponse(frames, np.ones(count, dtype=bool), 2, jacobian)
    time, pressures = np.arange(float(count)), np.full((count, 2), pressure)
    readings = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 1))
    run = CalibrationRun("run", time, pressures, ("measured",) * 2, SUITE, readings, pulls, NAMES)
    nodes = Nodes(run, time, pressures, readings, pulls, np.ones(count), np.zeros(count, dtype=np.int64))
    at = NodePredictions(innovation, np.zeros((count, 6, 0)), np.zeros((count, 6, 6)), response)
    return at, by_pull(nodes)


def shares(innovation: Floats, pressure: float = 0.0) -> dict[str, Value]:
    at, nodes = run_of(PULLS, innovation, pressure)
    return force_memory_shares(SETTING, [at], [nodes], {})


def kept_of(each: list[float]) -> Floats:
    """Return innovations of which a share of each pull is left once it is over, shape (nodes, 6)."""
    slack = ~PULLS.any(axis=1)
    over = np.cumsum(slack) - 1  # pulls that are over, at a slack node
    left = 0.5 * np.concatenate([[0.0], np.cumsum(each)])[over] * slack
    return np.outer(left, TO_FORCES @ [0.6, 0.8, 0.0])


def test_a_change_between_slack_and_slack_is_a_share_of_the_largest_pull() -> None:
    found = shares(kept_of([0.02, 0.02, 0.02]))["tip"]
    assert found.value == pytest.approx(0.02)
    assert found.std == pytest.approx(0.0, abs=1e-9)


def test_shares_of_further_pulls_lie_within_two_deviations_in_95_of_100_cases() -> None:
    rng, inside = np.random.default_rng(7), []
    for _ in range(400):
        *seen, further = rng.normal(0.02, 0.005, 4).tolist()
        found = shares(kept_of(seen))["tip"]
        inside.append(abs(further - found.value) < 2.0 * found.std)
    assert np.mean(inside) == pytest.approx(0.9545, abs=0.03)


def test_what_readings_are_off_by_before_a_pull_and_during_it_is_not_remembered() -> None:
    taut = PULLS.any(axis=1)[:, None]
    found = shares(0.3 * np.ones((len(PULLS), 6)) + 0.1 * taut)
    assert found["tip"].value == pytest.approx(0.0, abs=1e-9)


def test_without_a_vented_pull_nothing_is_told() -> None:
    assert shares(np.zeros((len(PULLS), 6)), pressure=2e4) == {}
    assert force_memory_shares(SETTING, *zip(run_of(0.0 * PULLS, 0.0 * PULLS @ TO_FORCES.T)), {}) == {}


def test_under_pressure_torsion_scatters_no_less_than_in_free_poses() -> None:
    """Pulls against pressures stay in one plane, and do not show it; bending they do."""
    free = run_of(0.0 * PULLS, np.full((len(PULLS), 6), 0.03), 2e4)
    held = run_of(PULLS + 0.1, np.full((len(PULLS), 6), 0.01), 2e4)
    evaluations, nodes = zip(free, held, strict=True)
    scatter = scatter_by_condition(evaluations, nodes)
    assert scatter["frame_tip torsion, pressurised pulls"] == pytest.approx(0.03)
    assert scatter["frame_tip rotation, pressurised pulls"] == pytest.approx(0.01)
