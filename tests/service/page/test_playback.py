"""A recording read at a time, and the surface bent along its sections."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softarm.estimator.errors import InputError
from softarm.estimator.recording import POSE_SUFFIXES, Recording
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.body import Chamber, Section
from softarm.page.playback import Playback, bent_surface
from softarm.page.player import marks
from softarm_client.messages import SectionPose

LENGTH_M = 0.2


def arm(azimuths=(0.0,), to_m=LENGTH_M, **parts):
    """A specimen from face to face with one chamber at each azimuth."""
    ends = {"base": 0.0, "tip": LENGTH_M}
    sections = tuple(Section(name=n, from_m=z, to_m=z, frame_origin_m=(0.0, 0.0, z)) for n, z in ends.items())
    chambers = tuple(
        Chamber(index=k, segment="lower", azimuth_rad=a, from_m=0.0, to_m=to_m, pressure_limit_pa=65e3)
        for k, a in enumerate(azimuths)
    )
    return load_specimen("sopra").model_copy(update={"sections": sections, "chambers": chambers, **parts})


ARM = arm()
HEIGHTS = np.linspace(0.0, LENGTH_M, 9)
LINE = np.column_stack([np.zeros((9, 2)), HEIGHTS])


def bent(angle):
    """Pose of the tip of an arc that bends about y."""
    radius = LENGTH_M / angle
    quaternion = np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0
    return radius * (1.0 - np.cos(angle)), 0.0, radius * np.sin(angle), *quaternion


def poses(angle):
    both = {"base": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "tip": bent(angle)}
    return [
        SectionPose(section=name, position_m=pose[:3], quaternion_wxyz=pose[3:])
        for name, pose in both.items()
    ]


def recording(sections=("base", "tip"), **changes):
    """An arm that bends with time; every other sample holds an estimate, the others pressures and a gauge."""
    time = 0.1 * np.arange(21)
    estimated = np.arange(21) % 2 == 0
    columns = {"pressure_0_pa": np.where(estimated, np.nan, 1e4 * time), "gauge_tip_n": 0.1 * time}
    for name in sections:
        values = [bent(0.01 + t) if name == "tip" else (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) for t in time]
        for suffix, column in zip(POSE_SUFFIXES, np.transpose(values), strict=True):
            columns[f"estimate_frame_{name}_{suffix}"] = np.where(estimated, column, np.nan)
    for axis, force in zip("xyz", (0.3, 0.4, 0.0), strict=True):
        columns[f"estimate_force_tip_{axis}_n"] = np.where(estimated, force * time, np.nan)
        deviation = np.nan if axis == "z" else 0.02
        columns[f"estimate_force_tip_{axis}_std_n"] = np.where(estimated, deviation, np.nan)
    return Recording("pull", time, columns | changes, {"arm": "left", "started_by": "ann"})


def test_each_stream_shows_its_last_reading_up_to_the_time():
    playback = Playback(recording(), ARM)
    instant = playback.at(1.05)
    (load,) = instant.loads
    assert load.force_n == pytest.approx((0.3, 0.4, 0.0))  # of the estimate at 1.0 s
    assert load.covariance_n2[0][0] == pytest.approx(4e-4)
    assert load.covariance_n2[2] == (None, None, None)
    assert instant.measured_pa == pytest.approx((0.9e4,))  # of 0.9 s
    assert instant.setpoints_pa == (None,)
    assert instant.gauges_n == pytest.approx({"tip": 0.1})
    assert instant.sections[1].position_m == pytest.approx(bent(1.01)[:3])
    assert playback.at(-5.0).sections == playback.at(0.0).sections
    assert playback.force_sizes[0][-1] == pytest.approx(1.0)


def test_a_slider_has_a_mark_for_events_that_can_be_told_apart():
    assert marks((0.2, 0.201, 5.0, 11.0, -1.0), 0.0, 10.0) == (0.2, 5.0)
    assert marks((), 0.0, 10.0) == ()


def test_a_recording_without_estimates_says_how_to_get_them():
    with pytest.raises(InputError, match="holds no estimated poses; run softarm estimate"):
        Playback(recording(sections=()), ARM)


def test_a_recording_of_another_arm_is_refused_with_the_sections_that_differ():
    with pytest.raises(InputError, match=r"does not have: elbow; .* --specimen"):
        Playback(recording(sections=("base", "elbow")), ARM)


def test_a_recording_whose_searches_all_failed_is_refused():
    lost = {f"estimate_frame_tip_{suffix}": np.full(21, np.nan) for suffix in POSE_SUFFIXES}
    with pytest.raises(InputError, match="no estimate that converged"):
        Playback(recording(**lost), ARM)


def test_an_arm_at_rest_keeps_its_surface_and_moves_with_its_frame():
    ring = LINE + np.array([0.03, 0.01, 0.0])
    straight = [
        section.model_copy(update={"quaternion_wxyz": (1.0, 0.0, 0.0, 0.0)}) for section in poses(1.0)
    ]
    at_rest = [
        section.model_copy(update={"position_m": (0.0, 0.0, height)})
        for section, height in zip(straight, (0.0, LENGTH_M), strict=True)
    ]
    np.testing.assert_allclose(bent_surface(ring, ARM, at_rest), ring, atol=1e-12)
    turn, shift = Rotation.from_rotvec((0.3, -0.5, 0.2)), np.array([0.1, 0.0, 0.0])
    quaternion = tuple(turn.as_quat(scalar_first=True))
    moved = [
        SectionPose(
            section=s.section,
            position_m=turn.apply(s.position_m) + shift,
            quaternion_wxyz=quaternion,
        )
        for s in at_rest
    ]
    np.testing.assert_allclose(bent_surface(ring, ARM, moved), turn.apply(ring) + shift, atol=1e-12)


def test_an_arm_bent_to_an_arc_is_drawn_within_a_hundredth_of_its_length():
    drawn = bent_surface(LINE, ARM, poses(1.0))
    angles = HEIGHTS / LENGTH_M  # a radius of one length bends it by one radian
    exact = LENGTH_M * np.column_stack([1.0 - np.cos(angles), np.zeros(9), np.sin(angles)])
    assert np.linalg.norm(drawn - exact, axis=1).max() < 0.01 * LENGTH_M
