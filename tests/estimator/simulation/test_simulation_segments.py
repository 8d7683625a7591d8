import numpy as np

from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp
from tests.estimator.derivatives import derivative_error
from tests.estimator.simulation.straight_arm import REST, SEGMENTS, twists_by_strains


def bent() -> Frames:
    turn = exp(np.array([[0.3, -0.5, 0.1], [0.2, 0.7, -0.2]]))
    return Frames(np.array([[0.02, -0.01, 0.12], [0.08, 0.03, 0.22]]), turn)


def test_rows_are_the_derivative_of_the_strains():
    frames = bent()

    def strains(twist: np.ndarray) -> np.ndarray:
        parts = twist.reshape(2, 6)
        moved = Frames(frames.positions + parts[:, :3], exp(parts[:, 3:]) @ frames.rotations)
        return SEGMENTS.strains(moved).reshape(-1)

    rows = SEGMENTS.rows(frames).reshape(8, 12)
    assert derivative_error(strains, rows, np.zeros(12), 1e-4) < 1e-7


def test_an_arm_at_rest_has_no_strain():
    assert np.abs(SEGMENTS.strains(REST)).max() < 1e-12
    assert np.allclose(SEGMENTS.rows(REST).reshape(8, 12) @ twists_by_strains(), np.eye(8), atol=1e-12)


def test_an_arc_keeps_its_length():
    beta = 0.9
    chord = 0.13 * np.sin(beta / 2) / (beta / 2)
    turn = exp(np.array([0.0, beta, 0.0]))
    half = exp(np.array([0.0, beta / 2, 0.0]))
    place = half @ np.array([0.0, 0.0, chord])
    frames = Frames(np.array([place, place + turn @ np.array([0.0, 0.0, 0.14])]), np.stack([turn, turn]))
    assert np.allclose(SEGMENTS.strains(frames), [[0, beta, 0, 0], [0, 0, 0, 0]], atol=1e-12)


def test_couples_balance_within_the_segment():
    couples = np.zeros((2, 4))
    couples[1] = [0.1, -0.2, 0.05, 0.3]
    frames = bent()
    wrench = SEGMENTS.wrenches(frames, couples)
    moment = (np.cross(frames.positions, wrench[:, :3]) + wrench[:, 3:]).sum(axis=0)
    assert np.allclose(wrench[:, :3].sum(axis=0), 0.0, atol=1e-12)
    assert np.allclose(moment, 0.0, atol=1e-12)
