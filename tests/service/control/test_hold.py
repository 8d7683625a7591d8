import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from softarm.daemon.control.hold import HoldGoal, HoldLimits, advance_hold, begin_hold
from softarm.daemon.control.poses import PoseStore, SavedPose
from softarm.estimator.errors import InputError

LIMITS = HoldLimits(rate=1.0, authority=10e3, maximum=np.full(6, 65e3))
PRESSURES = arrays(float, 6, elements=st.floats(0.0, 65e3))
STEP_S = 0.01


def run(hold, steps, measure):
    path, now = [], hold.begin_ns
    for _ in range(steps):
        now += round(STEP_S * 1e9)
        hold, wanted = advance_hold(hold, measure(path), now, STEP_S, LIMITS)
        path.append(wanted)
    return hold, np.array(path)


@given(start=PRESSURES, goal=PRESSURES)
def test_ramp_has_no_bump_and_arrives(start, goal):
    hold = begin_hold(HoldGoal(goal), start, 0, ramp_s=1.0)
    _, path = run(hold, 120, lambda _: np.zeros(6))
    steps = np.abs(np.diff(np.vstack([start, path]), axis=0))
    # A cubic's steepest slope is 1.5 times the mean.
    assert np.all(steps <= 1.5 * STEP_S * np.abs(goal - start) + 1e-6)
    np.testing.assert_allclose(path[-1], goal, atol=1e-6)


@settings(deadline=None)
@given(
    goal=arrays(float, 6, elements=st.floats(10e3, 50e3)),
    bias=arrays(float, 6, elements=st.floats(-8e3, 8e3)),
)
def test_feedback_removes_what_the_model_has_wrong(goal, bias):
    hold = begin_hold(HoldGoal(goal), goal, 0, ramp_s=0.1)
    hold, path = run(hold, 1500, lambda path: goal - path[-1] + bias if path else np.zeros(6))
    np.testing.assert_allclose(path[-1] - bias, goal, atol=5.0)


def test_correction_keeps_to_its_authority_and_pressures_to_their_limits():
    goal = np.full(6, 60e3)
    hold = begin_hold(HoldGoal(goal), goal, 0, ramp_s=0.1)
    hold, path = run(hold, 5000, lambda _: np.full(6, 5e3))
    assert np.all(hold.correction == LIMITS.authority)
    assert np.all(path <= LIMITS.maximum)


def test_no_estimate_freezes_the_correction():
    goal = np.full(6, 30e3)
    hold = begin_hold(HoldGoal(goal), goal, 0, ramp_s=0.1)
    hold, _ = run(hold, 100, lambda _: None)
    assert np.all(hold.correction == 0.0)


def test_poses_survive_a_restart(tmp_path):
    path = tmp_path / "state" / "poses.json"
    pose = SavedPose(pressures_pa=(2.0,), sections=(), saved_unix_ns=3)
    PoseStore(path).save("a", pose)
    assert PoseStore(path).names == ("a",)
    assert PoseStore(path).get("a") == pose


def test_broken_pose_file_is_named(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text("{")
    with pytest.raises(InputError, match=r"poses\.json"):
        PoseStore(path)
