"""From a recording to a session: known loads, evidence that is not counted twice, noise of means."""

import numpy as np
import pytest

from softarm.estimator.diagnosis.prepare import averaged, prepare
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen

SOPRA = load_specimen("sopra")
SECTIONS = ("base", "intermediate", "tip")
HEIGHTS = {"base": 0.0, "intermediate": 0.125, "tip": 0.27}
TIME = np.arange(0.0, 30.0, 0.02)


def _recording(more: dict[str, np.ndarray] | None = None, **info: object) -> Recording:
    """The arm hanging straight, every section seen, one chamber going up and down."""
    columns = {"pressure_0_pa": 2e4 * np.sin(0.3 * TIME) ** 2}
    for section, height in HEIGHTS.items():
        pose = {"x_m": 0.0, "y_m": 0.0, "z_m": height, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
        columns |= {f"frame_{section}_{name}": np.full(len(TIME), value) for name, value in pose.items()}
    return Recording("run", TIME, columns | (more or {}), info)


def _gauge(pull: float) -> dict[str, np.ndarray]:
    hook = {"x": 0.5, "y": 0.0, "z": HEIGHTS["tip"]}
    columns = {f"marker_hook_{axis}_m": np.full(len(TIME), value) for axis, value in hook.items()}
    return columns | {"gauge_cord_n": np.where(TIME > 10.0, pull, 0.0)}


def test_a_gauge_whose_hook_is_seen_is_a_known_load() -> None:
    found = prepare(_recording(_gauge(0.4), gauge_section="tip"), SOPRA, SECTIONS, nominal=False)
    wrenches = found.session.wrenches
    np.testing.assert_allclose(
        wrenches[found.session.clock > 10.1, 2, :3], [[0.4, 0.0, 0.0]] * 994, atol=1e-9
    )
    assert not wrenches[:, :2].any()
    assert not wrenches[found.session.clock < 9.9].any()


def test_a_gauge_that_pulls_nobody_knows_where_is_told() -> None:
    pulled = {"gauge_cord_n": _gauge(0.4)["gauge_cord_n"]}
    found = prepare(_recording(pulled), SOPRA, SECTIONS, nominal=False)
    assert not found.session.wrenches.any()
    assert any("its force is not in the model" in note for note in found.notes)


def test_a_slack_gauge_is_no_load() -> None:
    found = prepare(_recording(_gauge(0.01), gauge_section="tip"), SOPRA, SECTIONS, nominal=False)
    assert not found.session.wrenches.any()
    assert not any("gauge" in note for note in found.notes)


def test_a_saturated_gauge_is_refused_as_a_calibration_refuses_it() -> None:
    gauge = _gauge(0.0)
    gauge["gauge_cord_n"] = np.minimum(0.8 * np.sin(0.9 * TIME) ** 2, 0.4)
    with pytest.raises(InputError, match="saturated gauge"):
        prepare(_recording(gauge, gauge_section="tip"), SOPRA, SECTIONS, nominal=False)


def test_bends_that_repeat_the_frames_are_left_out() -> None:
    zero = np.zeros(len(TIME))
    bends = {f"bend_tip_{axis}_rad": zero for axis in "xy"}
    found = prepare(_recording(bends), SOPRA, SECTIONS, nominal=False)
    assert not any(m.name.startswith("bend") for m in found.session.suite.measurements)
    assert any("repeat the frames" in note for note in found.notes)
    apart = {name: values + 0.1 for name, values in bends.items()}
    kept = prepare(_recording(apart), SOPRA, SECTIONS, nominal=False)
    assert any(m.name == "bend_tip" for m in kept.session.suite.measurements)


def test_the_noise_of_means_falls_with_the_root_of_their_number() -> None:
    bends = np.random.default_rng(0).normal(0.0, 0.01, (2, len(TIME)))
    columns = {"pressure_0_pa": 2e4 * np.sin(0.3 * TIME) ** 2}
    columns |= {f"bend_tip_{axis}_rad": bend for axis, bend in zip("xy", bends, strict=True)}
    session = prepare(Recording("run", TIME, columns), SOPRA, SECTIONS, nominal=False).session
    mean = averaged(session, 0.1)
    assert mean.step == pytest.approx(0.1)
    np.testing.assert_allclose(mean.sigma, 0.01 / np.sqrt(5.0), rtol=0.6)
    np.testing.assert_allclose(mean.readings.mean(axis=0), session.readings.mean(axis=0), atol=1e-3)


@pytest.mark.parametrize("begin", [-0.2, 0.003, 1.7e9])
@pytest.mark.parametrize(("rate", "seconds"), [(50.0, 600.0), (100.0, 75.0), (240.0, 300.0), (120.0, 1.5)])
def test_samples_are_in_the_same_windows_and_stretches_wherever_time_begins(
    begin: float, rate: float, seconds: float
) -> None:
    def blocks(start: float) -> tuple[list[float], list[int]]:
        time = start + np.arange(round(rate * seconds)) / rate
        columns = {"pressure_0_pa": 2e4 * np.sin(0.3 * (time - start)) ** 2}
        columns |= {f"bend_tip_{axis}_rad": np.arange(len(time)) * 1e-5 for axis in "xy"}
        found = averaged(
            prepare(Recording("run", time, columns), SOPRA, SECTIONS, nominal=False).session, 0.1
        )
        return found.readings[:, 0].tolist(), found.blocks.tolist()

    (means, stretches), (other_means, other_stretches) = blocks(0.0), blocks(begin)
    assert other_means == pytest.approx(means, abs=1e-12)
    assert other_stretches == stretches


def test_gravity_that_is_not_a_vector_is_refused() -> None:
    with pytest.raises(InputError, match="gravity_m_s2: is"):
        prepare(_recording(gravity_m_s2=[0.0, 9.81]), SOPRA, SECTIONS, nominal=False)


def test_markers_that_the_specimen_lacks_are_left_out_and_named() -> None:
    other = {f"marker_other_{axis}_m": np.full(len(TIME), 0.1) for axis in "xyz"}
    found = prepare(_recording(other), SOPRA, SECTIONS, nominal=False)
    assert not any(m.name == "marker_other" for m in found.session.suite.measurements)
    assert found.notes == ("run: markers other are not in the specimen and left out.",)
    alone = Recording("run", TIME, {"pressure_0_pa": np.zeros(len(TIME)), **other})
    with pytest.raises(InputError, match=r"none of its markers \(other\) is in the specimen"):
        prepare(alone, SOPRA, SECTIONS, nominal=False)


def test_pressures_and_motion_that_are_never_present_together_are_refused() -> None:
    pressures = np.where(TIME > 15.0, 1e4, np.nan)
    moved = np.where(TIME < 14.0, 0.1, np.nan)
    bends = {f"bend_tip_{axis}_rad": moved for axis in "xy"}
    with pytest.raises(InputError, match="never present together"):
        prepare(Recording("run", TIME, {"pressure_0_pa": pressures, **bends}), SOPRA, SECTIONS, nominal=False)


def test_long_windows_are_kept_where_the_pressures_rest() -> None:
    """Means over a vibration say where the arm rests; while pressures change it rests nowhere."""
    held = np.where(TIME < 15.0, 2e4, 2e4 + 1e3 * (TIME - 15.0))
    moving = prepare(_recording({"pressure_0_pa": held}), SOPRA, SECTIONS, nominal=False).session
    mean = averaged(moving, 1.0)
    assert mean.clock.max() < 15.0
    assert mean.samples == 15
    changing = prepare(_recording({"pressure_0_pa": 2e3 * TIME}), SOPRA, SECTIONS, nominal=False).session
    assert averaged(changing, 1.0).samples == 30


def test_mean_orientations_are_of_unit_length_and_their_noise_is_an_angle() -> None:
    rng = np.random.default_rng(0)
    angles = rng.normal(0.0, 0.004, len(TIME))
    tip = {"frame_tip_qw": np.cos(0.5 * angles), "frame_tip_qx": np.sin(0.5 * angles)}
    session = prepare(_recording(tip), SOPRA, SECTIONS, nominal=False).session
    mean = averaged(session, 0.1)
    part = mean.suite.reading_slices["frame_tip"]
    np.testing.assert_allclose(np.linalg.norm(mean.readings[:, part][:, 3:], axis=1), 1.0, atol=1e-12)
    sigma = mean.sigma[mean.suite.slices["frame_tip"]]
    assert sigma[3] == pytest.approx(0.004 / np.sqrt(5.0), rel=0.6)
    assert sigma[4] < 0.5 * sigma[3]
