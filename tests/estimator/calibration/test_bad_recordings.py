"""Recordings that cannot carry a calibration: each is named, with the manoeuvre that is missing."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from synthetic import record
from toy import toy

from softarm.estimator.calibration import (
    CalibrationRefusedError,
    CalibrationRun,
    Check,
    Options,
    arrange,
    calibrate,
    cautions,
    check_drift,
)
from softarm.estimator.calibration.acceptance import WORSE, require_improvement
from softarm.estimator.calibration.data_quality import data_quality_notes
from softarm.estimator.calibration.nodes import choose_nodes
from softarm.estimator.errors import InputError
from softarm.estimator.model import Load
from softarm.estimator.recording import Recording
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.specimen import Specimen, load_specimen

SECTIONS = ("base", "intermediate", "tip")
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
LOADS = tuple(Load(f"tip_{name}", "force", axis, section="tip") for name, axis in AXES.items())


@pytest.fixture(scope="module")
def sopra() -> Specimen:
    return load_specimen("sopra")


def gauged(tension: np.ndarray) -> Recording:
    base = record(duration=20.0, kinds=("bend", "frame"))
    columns = {**base.columns, "gauge_cord_n": np.resize(tension, len(base.time))}
    return Recording("run", base.time, columns, {"gauge_section": "tip", "gauge_direction": [1.0, 0.0, 0.0]})


def test_a_fit_that_does_not_converge_is_refused(sopra: Specimen) -> None:
    run = arrange(record(), sopra, SECTIONS)
    with pytest.raises(
        CalibrationRefusedError,
        match=r"does not converge: .* would still move .*; .*, and hold random poses; the old",
    ):
        calibrate(SequentialBatchModel(toy()), sopra, [run], Options(nodes=40, iterations=1))


def test_readings_that_do_not_follow_the_pressures_are_refused(sopra: Specimen) -> None:
    base, rng = record(), np.random.default_rng(5)
    noise = {name: rng.normal(0.0, 0.2, len(base.time)) for name in base.columns if name.startswith("bend")}
    run = arrange(Recording("run", base.time, {**base.columns, **noise}, base.info), sopra, SECTIONS)
    message = (
        r"no better than their mean: they vary by .* degrees rms, and the error of the model is .*; the old"
    )
    with pytest.raises(CalibrationRefusedError, match=message):
        calibrate(SequentialBatchModel(toy()), sopra, [run], Options(nodes=80))


def test_a_chamber_with_a_wrong_number_is_refused(sopra: Specimen) -> None:
    base = record(chambers=(0,), kinds=("frame",))
    columns = {name.replace("pressure_0", "pressure_1"): values for name, values in base.columns.items()}
    run = arrange(Recording("run", base.time, columns, base.info), sopra, SECTIONS)
    with pytest.raises(CalibrationRefusedError, match=r"no better than their mean: they vary by .* mm rms"):
        calibrate(SequentialBatchModel(toy()), sopra, [run], Options(nodes=80))


def test_a_fit_that_predicts_worse_is_refused_unless_the_old_one_has_seen_the_samples() -> None:
    worse = Check({"a.0": 1.0}, {"a.0": 1.0}, {"a.0": 1.1}, {}, 0)
    with pytest.raises(CalibrationRefusedError, match=r"worse than before, with 1\.1 times the error"):
        require_improvement(worse, 1.0)
    require_improvement(worse, WORSE)
    require_improvement(replace(worse, held_out={"a.0": 0.9}), 1.0)


def test_a_kept_calibration_is_cautioned_about(sopra: Specimen) -> None:
    run = arrange(record(), sopra, SECTIONS)
    found = calibrate(SequentialBatchModel(toy()), sopra, [run], Options(nodes=40, iterations=8))
    assert cautions(found) == ()
    short = replace(found, check=replace(found.check, held_out={}), status="iterations_exhausted")
    remaining_steps, unchecked = cautions(short)
    assert "used all its iterations" in remaining_steps
    assert "nothing checks it" in unchecked
    check = Check({"a.0": 9.0}, {"a.0": 1.0}, {"a.0": 5.0}, {"a.0": 1.25}, 3)
    unlike, line = cautions(replace(found, check=check))
    assert "5 times the error of the fitted samples" in unlike
    assert "4 times that of a linear regression" in line


def test_an_arm_with_chambers_of_which_no_pressure_was_recorded_is_refused(sopra: Specimen) -> None:
    base = record()
    motion = {name: values for name, values in base.columns.items() if not name.startswith("pressure")}
    with pytest.raises(InputError, match="holds no pressures"):
        arrange(Recording("run", base.time, motion, base.info), sopra, SECTIONS)


def test_set_points_stand_for_pressures_that_were_never_measured(sopra: Specimen) -> None:
    base = record()
    asked = {f"pressure_cmd_{k}_pa": base.columns[f"pressure_{k}_pa"] for k in base.chambers}
    lost = {f"pressure_{k}_pa": np.full(len(base.time), np.nan) for k in base.chambers}
    run = arrange(Recording("run", base.time, {**base.columns, **lost, **asked}, base.info), sopra, SECTIONS)
    assert set(run.pressure_source) == {"commanded"}
    np.testing.assert_allclose(run.pressures, arrange(base, sopra, SECTIONS).pressures)


RAMP = np.linspace(0.0, 1.5, 2000)
STEPS = np.repeat(np.linspace(0.0, 1.5, 20), 100)
"""A gauge without noise rests at each step."""
NOISE = np.random.default_rng(3).normal(0.0, 0.004, 2000)
CLIPPED = {
    "a third of a ramp": np.minimum(RAMP, 1.0),
    "three in a hundred of a ramp": np.minimum(RAMP, 1.455),
    "two of noisy steps": np.minimum(np.round(STEPS + NOISE, 2), 1.38),
    "two of noisy steps, pushed": -np.minimum(np.round(STEPS + NOISE, 2), 1.38),
    "two of quiet steps": np.minimum(STEPS, 1.38),
}
WHOLE = {
    "a ramp": RAMP,
    "noisy steps": np.round(STEPS + NOISE, 2),
    "quiet steps": STEPS,
    "a slack cord": NOISE,
}


def moved(tension: np.ndarray) -> Recording:
    """A gauge whose hook goes 80 mm away in steps."""
    base = gauged(np.zeros(1))
    chosen = np.linspace(0, len(STEPS) - 1, len(base.time)).astype(int)
    told = gauged(tension[chosen])
    hook = 0.3 + 0.08 * STEPS[chosen] / 1.5
    columns = {"marker_hook_x_m": hook, "marker_hook_y_m": 0.0 * hook, "marker_hook_z_m": 0.0 * hook}
    return Recording("run", told.time, {**told.columns, **columns}, told.info)


@pytest.mark.parametrize("name", CLIPPED)
def test_a_saturated_gauge_is_refused(sopra: Specimen, name: str) -> None:
    message = r"gauge cord: saturated gauge: .* the end of its range; pull less, or with a larger gauge"
    with pytest.raises(InputError, match=message):
        arrange(moved(CLIPPED[name]), sopra, SECTIONS, LOADS)


@pytest.mark.parametrize("name", WHOLE)
def test_a_gauge_within_its_range_is_not(sopra: Specimen, name: str) -> None:
    recording = moved(WHOLE[name])
    assert not any(
        "saturated" in note
        for note in data_quality_notes(recording, arrange(recording, sopra, SECTIONS, LOADS))
    )


def test_a_gauge_that_tells_nothing_beyond_its_range_is_named(sopra: Specimen) -> None:
    there_and_back = np.concatenate([STEPS[::2], STEPS[::-2]]) + NOISE
    for tension, said in (
        (np.where(there_and_back > 1.2, np.nan, there_and_back), True),
        (there_and_back, False),
    ):
        recording = moved(tension)
        found = data_quality_notes(recording, arrange(recording, sopra, SECTIONS, LOADS))
        assert [": saturated gauge: silent for" in line for line in found] == [True] * said


@pytest.mark.parametrize(
    ("tension", "message"),
    [(0.01, "its cord was slack throughout, .*; move the gauge away"), (np.nan, "never answered; check its")],
)
def test_a_gauge_that_tells_nothing_is_named(sopra: Specimen, tension: float, message: str) -> None:
    recording = gauged(np.full(400, tension))
    (note,) = data_quality_notes(recording, arrange(recording, sopra, SECTIONS, LOADS))
    assert note.startswith("run, gauge cord: ")
    assert re.search(message, note)


def test_a_disconnected_sensor_is_named_with_what_to_record(sopra: Specimen) -> None:
    base = record(duration=20.0)
    lost = {name: np.full_like(column, np.nan) for name, column in base.columns.items() if "bend_tip" in name}
    recording = Recording("run", base.time, {**base.columns, **lost})
    (note,) = data_quality_notes(recording, arrange(recording, sopra, SECTIONS))
    assert note == (
        "run, bend_tip: never answered; connect it or bring its markers into view, "
        "and record poses of more than 10 degrees"
    )


def test_pulls_in_an_unknown_direction_are_left_out(sopra: Specimen) -> None:
    number = np.arange(400)
    steps = np.where(number % 100 < 50, 0.01, 0.5 + 1e-3 * (number % 3))
    recording = gauged(steps)
    told = {name: value for name, value in recording.info.items() if name != "gauge_direction"}
    run = arrange(Recording("run", recording.time, recording.columns, told), sopra, SECTIONS, LOADS)
    assert np.isnan(run.loads[60:90]).all()  # short gaps are bridged
    np.testing.assert_array_equal(run.loads[100:150], 0.0)
    assert not np.isnan(choose_nodes(run, 20).loads).any()


def test_a_sensor_that_never_answered_is_gone_on_without(sopra: Specimen) -> None:
    base = record(duration=20.0, kinds=("bend", "frame"))
    lost = {name: np.full_like(v, np.nan) for name, v in base.columns.items() if "frame_tip" in name}
    run = arrange(Recording("run", base.time, {**base.columns, **lost}), sopra, SECTIONS)
    nodes = choose_nodes(run, 12)
    assert len(nodes.time) == 12
    assert np.isnan(nodes.readings).all(axis=0).sum() == 7


@pytest.mark.parametrize("judge", [calibrate, check_drift])
def test_motion_without_known_forces_is_refused(
    sopra: Specimen, judge: Callable[[SequentialBatchModel, Specimen, list[CalibrationRun]], object]
) -> None:
    known = sopra.calibration.model_copy(update={"scatter": {"bend_tip": 0.01}})
    specimen = sopra.model_copy(update={"calibration": known})
    recording = gauged(np.full(400, 0.5))
    told = {"gauge_section": "tip"}
    run = arrange(Recording("run", recording.time, recording.columns, told), specimen, SECTIONS, LOADS)
    with pytest.raises(
        InputError, match=r"never measured at the same time; record them at once, with marker_hook"
    ):
        judge(SequentialBatchModel(toy()), specimen, [run])


def test_a_recording_without_fault_is_not_complained_of(sopra: Specimen) -> None:
    recording = gauged(np.linspace(0.0, 1.0, 400))
    assert data_quality_notes(recording, arrange(recording, sopra, SECTIONS, LOADS)) == ()


def test_nodes_of_a_pulled_run_are_chosen_where_it_rests(sopra: Specimen) -> None:
    base = record(duration=20.0, kinds=("bend", "frame"))
    phase = base.time % 4.0
    stairs = base.time // 4.0 + np.clip(phase - 3.0, 0.0, 1.0)
    moved = {**base.columns, "frame_tip_x_m": 0.01 * stairs, "gauge_cord_n": 0.1 * stairs}
    still = {n: np.full_like(v, v[0]) for n, v in moved.items() if n.startswith(("bend", "pressure"))}
    told = {"gauge_section": "tip", "gauge_direction": [1.0, 0.0, 0.0]}
    run = arrange(Recording("run", base.time, {**moved, **still}, told), sopra, SECTIONS, LOADS)
    nodes = choose_nodes(run, 5)
    assert (nodes.time % 4.0 < 3.0).all()
    np.testing.assert_allclose(nodes.loads[:, 0], 0.1 * (nodes.time // 4.0), atol=1e-9)
