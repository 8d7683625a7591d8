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


def test_gravity_that_is_not_a_vector_is_refused() -> None:
    with pytest.raises(InputError, match="is not three numbers"):
        prepare(_recording(gravity_m_s2=[0.0, 9.81]), SOPRA, SECTIONS, nominal=False)
