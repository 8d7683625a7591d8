"""Sensors and single axes that stand still are named with their time and reading, and lost to every fit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.intake import mismatch_finding
from softarm.estimator.intake import check_recording
from softarm.estimator.intake.stuck import correct_stuck
from softarm.estimator.recording import Recording
from tests.estimator.intake import small_arm as arm

SPECIMEN = arm.specimen()
FROM = 30.0
"""When a sensor stops that moves at first [s]."""


@pytest.fixture(scope="module")
def bends() -> Recording:
    return arm.small_arm(parts=("bend",))


def _held(recording: Recording, held: Mapping[str, float], since: float, noise: float = 0.0) -> Recording:
    rng = np.random.default_rng(5)
    late = recording.time >= since
    return replace(
        recording,
        columns={
            name: np.where(late, held[name] + noise * rng.normal(size=len(late)), values)
            if name in held
            else values
            for name, values in recording.columns.items()
        },
    )


CASES = {
    "one axis": ({"bend_tip_x_rad": 0.1}, "bend_tip.x stands still at 5.7 degrees"),
    "both axes": (
        {"bend_tip_x_rad": 0.1, "bend_tip_y_rad": -0.2},
        "bend_tip stands still at 5.7 and -11.5 degrees",
    ),
    "axis of the upper segment": (
        {"bend_intermediate_y_rad": 0.0},
        "bend_intermediate.y stands still at 0.0 degrees",
    ),
}


@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("since", [0.0, FROM])
@pytest.mark.parametrize("case", CASES)
def test_what_stands_still_is_named_and_lost(bends: Recording, case: str, since: float, noise: float) -> None:
    held, words = CASES[case]
    corrected, (fault,) = correct_stuck(_held(bends, held, since, noise), SPECIMEN)
    assert words in fault.statement.replace("-0.0", "0.0")
    assert fault.interval == pytest.approx((since, bends.time[-1]), abs=1.0)
    late = bends.time >= since
    for name, values in corrected.columns.items():
        if name in held:
            assert np.isnan(values[late]).all()
            np.testing.assert_array_equal(
                values[bends.time < since - 1.0], bends.columns[name][: np.sum(bends.time < since - 1.0)]
            )
        else:
            np.testing.assert_array_equal(values, bends.columns[name])


def test_an_axis_that_stands_still_is_a_finding_and_nothing_else_is_found(bends: Recording) -> None:
    intake = check_recording(_held(bends, {"bend_tip_x_rad": 0.1}, 0.0), SPECIMEN)
    assert (intake.events, len(intake.mismatches)) == ((), 1)
    finding = mismatch_finding(intake.mismatches[0])
    assert (finding.effect, finding.where.sensor, finding.where.axis) == ("sensor_stuck", "bend_tip", "x")
    assert finding.parameters["since"].value == pytest.approx(0.0)


@pytest.mark.parametrize("noise", [0.0, 2e-5])
def test_a_body_stands_still_that_hangs_below_one_that_moves(noise: float) -> None:
    recording = arm.small_arm(parts=("frame",))
    held = {n: float(v[recording.time >= FROM][0]) for n, v in recording.columns.items() if "frame_tip" in n}
    corrected, (fault,) = correct_stuck(_held(recording, held, FROM, noise), SPECIMEN)
    assert fault.columns == ("frame_tip",)
    assert fault.interval == pytest.approx((FROM, recording.time[-1]), abs=1.0)
    assert np.isnan(corrected.columns["frame_tip_x_m"][recording.time >= FROM + 1.0]).all()


@pytest.mark.parametrize("seed", range(6))
def test_sensors_that_live_are_left_alone(seed: int) -> None:
    recording = arm.small_arm(seed)
    assert correct_stuck(recording, SPECIMEN) == (recording, ())


def test_an_axis_that_no_chamber_moves_is_left_alone() -> None:
    """One segment is vented, or chambers of one plane move alone."""
    recording = arm.small_arm(2, parts=("bend",))
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1e-3, (2, len(recording.time)))
    vented = {f"pressure_{cmd}{k}_pa": 0.0 for cmd in ("", "cmd_") for k in (3, 4, 5)}
    lower = _held(recording, {**vented, "bend_tip_x_rad": 0.0, "bend_tip_y_rad": 0.0}, 0.0, 1e-3)
    assert correct_stuck(lower, SPECIMEN)[1] == ()
    pressure = recording.columns["pressure_0_pa"]
    plane = {"bend_intermediate_x_rad": -1e-5 * pressure + noise[0], "bend_intermediate_y_rad": noise[1]}
    vented = {f"pressure_{cmd}{k}_pa": 0.0 for cmd in ("", "cmd_") for k in range(1, 6)}
    planar = _held(recording, vented, 0.0)
    planar = replace(planar, columns={**planar.columns, **plane})
    assert correct_stuck(planar, SPECIMEN)[1] == ()


@pytest.mark.parametrize("common", [0.0, 40e3])
def test_chambers_that_push_alike_drive_nothing(bends: Recording, common: float) -> None:
    """What unequal gains make of a large pressure is no gain of the small differences between chambers."""
    rng, time = np.random.default_rng(3), bends.time
    x, y = (np.where((time + shift) % 16.0 < 8.0, 1.0, -1.0) for shift in (0.0, 4.0))
    pressures = (x, -0.5 * x + y, -0.5 * x - y) * 2
    columns = {
        f"pressure_{cmd}{k}_pa": common + 400.0 * (one + 1.5)
        for cmd in ("", "cmd_")
        for k, one in enumerate(pressures)
    }
    columns |= {
        name: 0.05 * x * name.endswith("x_rad") + rng.normal(0.0, 1e-3, len(time))
        for name in bends.columns
        if name.startswith("bend_")
    }
    _, faults = correct_stuck(replace(bends, columns={**bends.columns, **columns}), SPECIMEN)
    still = {name for fault in faults for name in fault.columns}
    assert not still if common else {"bend_intermediate.y", "bend_tip.y"} <= still


def test_a_recording_without_noise_is_left_alone(bends: Recording) -> None:
    """Nobody can tell a sensor that stands still from one that sees nothing move."""
    smooth = {
        name: bends.columns[name.replace("pressure_", "pressure_cmd_")]
        for name in bends.columns
        if name.startswith("pressure_") and "cmd" not in name
    }
    columns = {**bends.columns, **smooth}
    for section, first in (("intermediate", 0), ("tip", 3)):
        columns[f"bend_{section}_x_rad"] = 1e-5 * columns[f"pressure_{first}_pa"]
        columns[f"bend_{section}_y_rad"] = np.zeros(len(bends.time))
    columns |= {f"pressure_{k}_pa": np.zeros(len(bends.time)) for k in (1, 2, 4, 5)}
    still = replace(bends, columns=columns)
    assert correct_stuck(still, SPECIMEN)[1] == ()


@pytest.mark.parametrize("seconds", [0.5, 3.0])
@pytest.mark.parametrize("since", [5.0, FROM])
def test_missing_rows_hide_no_axis_that_stands_still(bends: Recording, since: float, seconds: float) -> None:
    """An axis that rests because nothing drives it is left alone on either side of them."""
    kept = np.asarray((bends.time < since) | (bends.time >= since + seconds))
    assert correct_stuck(bends.window(kept), SPECIMEN)[1] == ()
    held = {"bend_tip_x_rad": 0.1, "bend_tip_y_rad": -0.2}
    _, (fault,) = correct_stuck(_held(bends, held, 0.0, noise=2e-3).window(kept), SPECIMEN)
    assert "bend_tip stands still at 5.7 and -11.5 degrees" in fault.statement
    assert fault.interval == pytest.approx((0.0, bends.time[-1]), abs=1.0)


def _held_poses(lags: Mapping[str, float]) -> Recording:
    """Step through poses, each held for 4.5 s; bends follow their chambers, each with a lag [s]."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 60.0, 0.02)
    levels = rng.uniform(0.0, 45e3, (14, 6))
    columns = {f"pressure_{k}_pa": levels[(time // 4.5).astype(int), k] for k in range(6)}
    for first, (section, lag) in zip((0, 3), lags.items(), strict=True):
        own = levels[np.clip(((time - lag) // 4.5).astype(int), 0, 13), first : first + 3]
        for axis, gains in (("x", [1.0, -0.5, -0.5]), ("y", [0.0, 0.87, -0.87])):
            noise = rng.normal(0.0, 5e-4, len(time))
            columns[f"bend_{section}_{axis}_rad"] = 1e-5 * own @ gains + noise
    return Recording("run", time, columns)


@pytest.mark.parametrize("lag", [0.9, -0.9])
def test_a_bend_that_lags_behind_its_pressures_does_not_stand_still(lag: float) -> None:
    for other in (0.0, lag):
        _, faults = correct_stuck(_held_poses({"intermediate": other, "tip": lag}), SPECIMEN)
        assert not faults


def test_a_bend_that_lags_and_stops_stands_still() -> None:
    late = _held_poses({"intermediate": 0.9, "tip": 0.9})
    held = {f"bend_tip_{axis}_rad": 0.6 for axis in "xy"}
    _, (fault,) = correct_stuck(_held(late, held, since=FROM, noise=5e-4), SPECIMEN)
    assert fault.columns == ("bend_tip",)
    assert fault.interval is not None
    assert fault.interval[0] == pytest.approx(FROM, abs=0.5)


def test_a_body_that_stood_still_is_lost_to_the_sample() -> None:
    """The last tenth of a second would otherwise be a jump that no law explains."""
    good = arm.small_arm(parts=("frame",))
    begin, end = 30.1, 50.9
    first = int(np.argmax(good.time >= begin))
    tip = {name: values[first] for name, values in good.columns.items() if name.startswith("frame_tip")}
    held = _held(good, tip, since=begin, noise=2e-5)
    columns = {
        name: np.where(good.time < end, values, good.columns[name]) for name, values in held.columns.items()
    }
    corrected, (fault,) = correct_stuck(replace(held, columns=columns), SPECIMEN)
    assert fault.columns == ("frame_tip",)
    lost = good.time[np.isnan(corrected.columns["frame_tip_x_m"])]
    assert lost[0] == pytest.approx(begin, abs=0.06)
    assert lost[-1] == pytest.approx(end, abs=0.06)


@pytest.mark.parametrize(("pressed", "found"), [(0.0, ()), (2e4, (("frame_tip",),))])
def test_a_body_that_rests_is_not_stuck_though_one_above_was(
    pressed: float, found: tuple[object, ...]
) -> None:
    """At 20 s the arm is vented; the upper body shows it at 35 s, where another pressure would move both."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 40.0, 0.02)
    steps = {"intermediate": 35.0, "tip": 20.0}
    columns = {"pressure_0_pa": np.where(time < 20.0, 3e4, np.where(time < 30.0, 0.0, pressed))}
    for section, step in steps.items():
        moved = {"x": np.where(time < step, 0.04, 0.0), "y": 0.0, "z": 0.2}
        rotation = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
        columns |= {
            f"frame_{section}_{axis}_m": value + rng.normal(0.0, 2e-5, len(time))
            for axis, value in moved.items()
        }
        columns |= {f"frame_{section}_{part}": np.full(len(time), value) for part, value in rotation.items()}
    _, faults = correct_stuck(Recording("run", time, columns), SPECIMEN)
    assert tuple(fault.columns for fault in faults) == found
