import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.inverse import rectify
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.sensing import Bend, Orientation, Scene, SensorSuite

RANDOM = np.random.default_rng(8)
SIGMA = 0.002
TRUE = SensorSuite(
    (
        Orientation("tip", 1, SIGMA, np.array([0.05, -0.1, 0.2])),
        Bend("bend", 0, SIGMA, bias=np.array([0.08, -0.15])),
    )
)
NOMINAL = SensorSuite((Orientation("tip", 1, SIGMA), Bend("bend", 0, SIGMA)))


def rest_frames(arm) -> Frames:
    inputs = Inputs(np.zeros(6), np.zeros(4), np.array([0.0, 0.0, 9.81]))
    return arm.frames(arm.solve(inputs, arm.rest())[0])


def noisy_readings(frames: Frames, samples: int, size: float = SIGMA) -> np.ndarray:
    rows = []
    for _ in range(samples):
        turned = TRUE.with_parameters(
            TRUE.parameters + size * np.concatenate([RANDOM.normal(size=3), np.zeros(9)])
        )
        row = turned.predict(Scene(frames, np.zeros(0)))
        row[4:] += size * RANDOM.normal(size=2)
        rows.append(row)
    return np.array(rows)


def test_rest_alignment_is_found_within_its_covariance(arm) -> None:
    frames = rest_frames(arm)
    readings = noisy_readings(frames, 200)
    readings[:20, 4:] = np.nan
    found = rectify(NOMINAL, frames, readings)
    assert found.names == (*(f"tip.misalignment_{a}" for a in "xyz"), "bend.bias_x", "bend.bias_y")
    truth = np.array([0.05, -0.1, 0.2, 0.08, -0.15])
    spread = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.values - truth) < 4 * spread).all()
    assert spread == pytest.approx(SIGMA / np.sqrt(190), rel=0.15)
    assert found.residual_rms == pytest.approx(1.0, abs=0.15)
    aligned = found.suite.sensitivity(Scene(frames, np.zeros(0)), readings[50]).innovation
    assert np.abs(aligned).max() < 5 * SIGMA


def test_scatter_beyond_the_assumed_noise_widens_the_covariance(arm) -> None:
    frames = rest_frames(arm)
    found = rectify(NOMINAL, frames, noisy_readings(frames, 200, 3 * SIGMA))
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(3 * SIGMA / np.sqrt(200), rel=0.2)


def test_what_one_pose_cannot_tell_is_named(arm) -> None:
    frames = rest_frames(arm)
    with pytest.raises(InputError, match=r"do not determine bend\."):
        rectify(NOMINAL, frames, noisy_readings(frames, 5), ("bias_x", "section_tilt_y"))
    with pytest.raises(InputError, match="no sensor has"):
        rectify(NOMINAL, frames, noisy_readings(frames, 5), ("latency",))
