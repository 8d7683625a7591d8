"""Figures of errors, holds, leave-one-out and pulls: what the experiments' tables rest on."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.calibration import arrange, section_forces
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import Bend, MeasuredPose, Orientation
from softarm.estimator.specimen import load_specimen
from softarm.experiments.figures import error_figures, inside, with_paper, without_unit
from softarm.experiments.holds import hold_windows, means
from softarm.experiments.leave_one_out import without_each
from softarm.experiments.live import HookPlace, with_hooks
from softarm.experiments.live_tables import evaluate_taught
from softarm.experiments.paper import FORCE_N, TEACH_MM
from softarm.experiments.pulls import GaugePull, averaged_over, pull_of, rest_windows, rested
from softarm.experiments.recorded import holds_table
from softarm.experiments.seed import SeedResult
from softarm.experiments.subsets import subset
from softarm.experiments.teaching import TeachResult, out_of_reach, still_windows

RATE = 50.0


def test_figures_of_errors_leave_out_what_was_lost() -> None:
    row = error_figures(np.array([-1.0, 3.0, np.nan]), "mm")
    assert row == {"min_mm": 1.0, "max_mm": 3.0, "mean_mm": 2.0, "std_mm": 1.0}
    assert error_figures(np.full(3, np.nan), "mm")["mean_mm"] is None


def test_an_aim_is_met_only_below_it() -> None:
    for mean, met in ((TEACH_MM.aim, True), (1.01 * TEACH_MM.aim, False)):
        row = with_paper({"mean_mm": mean}, TEACH_MM, "mm")
        assert row["aim_met"] is met
        assert without_unit(row, "mm")["paper_mean"] == 5.2
    still = FORCE_N["not pressurised"]
    assert still.mean / still.span == pytest.approx(0.0105, abs=1e-4)


def test_normal_errors_lie_within_two_deviations_in_95_of_100() -> None:
    rng = np.random.default_rng(0)
    assert inside(rng.normal(0.0, 2.0, 20000), np.full(20000, 2.0)) == pytest.approx(0.9545, abs=0.005)


def recording(**columns: np.ndarray) -> Recording:
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    return Recording("run", time, columns, {"gauge_section": "tip"})


def posed(**more: np.ndarray) -> Recording:
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    columns: dict[str, np.ndarray] = {}
    for section, height in (("base", 0.0), ("intermediate", 0.1405), ("tip", 0.276)):
        values = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
        for name, value in zip(("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"), values, strict=True):
            columns[f"frame_{section}_{name}"] = np.full(len(time), value)
    return recording(**columns, **{f"pressure_{k}_pa": np.zeros(len(time)) for k in range(6)}, **more)


def hook(direction: tuple[float, float, float], reach: float = 0.3) -> dict[str, np.ndarray]:
    place = np.array([0.0, 0.0, 0.276]) + reach * np.array(direction) / np.linalg.norm(direction)
    count = int(20.0 * RATE)
    return {f"marker_hook_{axis}_m": np.full(count, place[k]) for k, axis in enumerate("xyz")}


def test_holds_are_found_where_commands_rest() -> None:
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    level = np.interp(time, [0, 5, 6, 11, 12, 20], [0, 0, 2e4, 2e4, 3e4, 3e4])
    windows = hold_windows(recording(pressure_cmd_0_pa=level), shortest=3.0, window_s=0.5)
    np.testing.assert_allclose(windows[:, 1], [5.0, 11.0, 20.0], atol=0.05)
    np.testing.assert_allclose(windows[:, 1] - windows[:, 0], 0.5)


def test_means_over_holds_are_those_of_the_samples() -> None:
    specimen = load_specimen("sopra")
    run = arrange(posed(), specimen, None, section_forces(specimen))
    held = means(run, np.array([[1.0, 2.0], [30.0, 31.0]]))
    assert len(held.time) == 1
    np.testing.assert_allclose(held.readings[0], run.readings[60])


def test_leaving_a_pose_out_is_refitting_without_it() -> None:
    rng = np.random.default_rng(1)
    residual, jacobian = rng.normal(size=(7, 3)), rng.normal(size=(7, 3, 4))
    prior = np.diag([0.1, 0.2, 0.3, 0.4])
    left = without_each(residual, jacobian, prior)
    for index in range(7):
        others = np.arange(7) != index
        rows = np.concatenate([jacobian[others].reshape(-1, 4), np.sqrt(prior)])
        wanted = np.concatenate([residual[others].ravel(), np.zeros(4)])
        step = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        np.testing.assert_allclose(left[index], residual[index] - jacobian[index] @ step, rtol=1e-9)


def test_a_pull_points_from_the_knot_to_the_hook() -> None:
    specimen = load_specimen("sopra")
    count = int(20.0 * RATE)
    told = posed(gauge_cord_n=np.linspace(0.0, 0.5, count), **hook((0.6, 0.8, 0.0)))
    run = arrange(told, specimen, None, section_forces(specimen))
    pull = pull_of(told, specimen, run.window(np.isin(run.time, run.time[[500, 950]])))
    assert pull.section == "tip"
    np.testing.assert_allclose(pull.lateral, [[0.6, 0.8, 0.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(pull.force, axis=1), [0.25, 0.475], atol=1e-3)
    np.testing.assert_allclose(run.loads[-1], [0.0, 0.0, 0.0, 0.3, 0.4, 0.0], atol=1e-9)


def test_a_gauge_that_reads_between_the_frames_pulls_along_its_cord() -> None:
    specimen = load_specimen("sopra")
    count = int(20.0 * RATE)
    told = posed(gauge_cord_n=np.linspace(0.0, 0.5, count), **hook((0.6, 0.8, 0.0)))
    odd = np.arange(count) % 2 == 1
    columns = {
        name: np.where(odd == name.startswith("gauge"), column, np.nan)
        for name, column in told.columns.items()
    }
    for name in ("x", "y", "z"):
        columns[f"marker_hook_{name}_m"][700:800] = np.nan  # taken off for two seconds
    apart = Recording(told.name, told.time, columns, told.info)
    run = arrange(apart, specimen, None, section_forces(specimen))
    np.testing.assert_allclose(run.loads[200, 3:5], [0.12, 0.16], atol=1e-3)
    assert np.isfinite(run.loads).all()
    tied = pull_of(apart, specimen, run).tied
    np.testing.assert_array_equal(
        tied[[300, 349, 375, 399, 401, 450]], [True, True, False, False, True, True]
    )


def test_readings_of_one_orientation_with_either_sign_are_averaged() -> None:
    told = posed()
    columns = dict(told.columns)
    for part in ("qw", "qx", "qy", "qz"):
        columns[f"frame_tip_{part}"] = np.where(np.arange(len(told.time)) % 2, 1.0, -1.0) * (part == "qx")
    run = arrange(Recording(told.name, told.time, columns, told.info), load_specimen("sopra"))
    held = means(run, np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(np.abs(held.readings[0, -4:]), [0.0, 1.0, 0.0, 0.0])


SICK = {
    "slack": (np.full(1000, 0.01), "the cord was slack; move the gauge away"),
    "silent": (np.full(1000, np.nan), "never answered; check its cable"),
    "saturated": (np.minimum(np.linspace(0.0, 1.5, 1000), 1.455), "saturated gauge: .*; pull less"),
}


@pytest.mark.parametrize("name", SICK)
def test_a_sick_gauge_is_named_with_its_cure(name: str) -> None:
    specimen = load_specimen("sopra")
    tension, message = SICK[name]
    told = posed(gauge_cord_n=tension, **hook((1.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=message):
        pull_of(told, specimen, arrange(told, specimen, None, section_forces(specimen)))


def test_a_marker_that_the_specimen_does_not_name_is_left_out_and_told() -> None:
    run = arrange(posed(**hook((1.0, 0.0, 0.0))), load_specimen("sopra"))
    assert run.ignored_markers == ("hook",)


def test_looks_end_where_the_gauge_sets_off() -> None:
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    told = posed(gauge_cord_n=0.02 * time, **hook((1.0, 0.0, 0.0)))
    columns = dict(told.columns)
    columns["marker_hook_x_m"] = 0.3 + np.interp(time, [0, 6, 7, 12, 13, 20], [0, 0, 0.01, 0.01, 0.02, 0.02])
    moved = Recording(told.name, told.time, columns, told.info)
    windows = rest_windows(moved)
    np.testing.assert_allclose(windows[:, 1], [6.0, 12.0, 19.9], atol=0.25)
    specimen = load_specimen("sopra")
    run = averaged_over(arrange(moved, specimen, None, section_forces(specimen)), windows)
    np.testing.assert_allclose(np.linalg.norm(run.loads, axis=1), 0.02 * run.time, atol=1e-3)


@pytest.mark.parametrize(
    ("kind", "sensors"), [("orientations", Orientation), ("poses", MeasuredPose), ("fused", MeasuredPose)]
)
def test_subsets_keep_one_kind_of_sensor(kind: str, sensors: type) -> None:
    run = arrange(posed(), load_specimen("sopra"))
    part = subset(run, kind)
    assert all(isinstance(m, sensors) for m in part.suite.measurements)
    assert part.readings.shape[1] == sum(m.reading_size for m in part.suite.measurements)
    with pytest.raises(InputError, match="holds nothing for 'bends'"):
        subset(run, "bends")


def test_bends_alone_are_kept_as_they_are() -> None:
    count = int(20.0 * RATE)
    told = posed(bend_tip_x_rad=np.full(count, 0.1), bend_tip_y_rad=np.full(count, 0.2))
    part = subset(arrange(told, load_specimen("sopra")), "bends")
    assert [type(m) for m in part.suite.measurements] == [Bend]
    np.testing.assert_allclose(part.readings[0], [0.1, 0.2])


def test_rests_are_found_where_commands_are_recorded_seldom() -> None:
    time = np.arange(0.0, 6.0, 0.01)
    command = np.where(time < 3.0, 0.0, np.where(time < 4.0, 1e4 * (time - 3.0), 1e4))
    command[np.arange(600) % 3 > 0] = np.nan
    hook = np.where(time < 1.0, np.nan, 0.3)
    columns = {"pressure_cmd_0_pa": command, **{f"marker_hook_{axis}_m": hook for axis in "xyz"}}
    found = rested(Recording("run", time, columns), np.array([0.8, 1.3, 1.8, 3.5, 4.3, 4.9]))
    np.testing.assert_array_equal(found, [True, False, True, False, False, True])


def test_still_windows_end_where_a_body_sets_off() -> None:
    time = np.arange(0.0, 12.0, 0.01)
    places = np.zeros((len(time), 3))
    places[:, 0] = np.interp(time, [0, 4, 5, 9, 9.5, 12], [0, 0, 0.05, 0.05, 0.02, 0.02])
    windows = still_windows(time, places)
    np.testing.assert_allclose(windows[:, 1], [4.0, 9.0, 12.0], atol=0.15)


def test_a_table_of_holds_begins_vented_and_holds_each_level() -> None:
    levels = np.array([[1e4] * 6, [2e4] * 6])
    times, points = holds_table(levels, 3.0, 1.0)
    np.testing.assert_allclose(np.diff(times), [3.0, 1.0, 3.0, 1.0, 3.0])
    np.testing.assert_allclose(points[:, 0], [0, 0, 1e4, 1e4, 2e4, 2e4])


def test_hooks_of_a_live_run_hold_until_the_next_one() -> None:
    hooks = [HookPlace(2.0, np.array([0.3, 0.0, 0.2])), HookPlace(5.0, np.full(3, np.nan))]
    told = with_hooks(posed(), hooks, "tip")
    x = told.columns["marker_hook_x_m"]
    assert np.isnan(x[: int(1.9 * RATE)]).all()
    assert np.isnan(x[int(5.1 * RATE) :]).all()
    np.testing.assert_allclose(x[int(2.1 * RATE) : int(4.9 * RATE)], 0.3)


def test_a_hook_is_where_it_was_measured_rather_than_where_it_was_told_to_be() -> None:
    """A body on the base is never quite aligned with it: two degrees are 10 mm at a hook 0.3 m away."""
    told = with_hooks(posed(), [HookPlace(0.0, np.zeros(3), np.array([0.3, 0.01, 0.2]))], "tip")
    np.testing.assert_allclose(told.columns["marker_hook_y_m"], 0.01)


def test_poses_out_of_reach_are_told_apart() -> None:
    beyond = np.array([[0.5, 0.2], [6.0, 0.2], [1.5, 1.0], [np.nan, np.nan]])
    missed = np.array([[1.0, 6.0, 2.0, 9.0], [0.5, 6.0, 1.5, 8.0]])
    result = TeachResult(missed, np.full((2, 4), 0.5), beyond, 1)
    first, _, last, _ = result.rows("either", result.near)
    assert (first["poses"], first["mean"], first["aim_met"]) == (2, pytest.approx(1.5), True)
    assert (last["run"], last["mean"]) == ("after 1 corrections by feedback", pytest.approx(1.0))
    assert result.rows("all")[0]["mean"] == pytest.approx(4.5)
    assert [row["nearest_in_reach"] for row in (first, *result.rows("all")[:2])] == pytest.approx(
        [1.0, 8.0 / 3.0, 1.4 / 3.0]  # [mm, mm, degrees]
    )
    assert not TeachResult(missed[:, 3:], missed[:, 3:], beyond[3:], 0).rows(
        "either", np.zeros(1, dtype=bool)
    )


def test_what_the_service_said_of_poses_out_of_reach_is_reported() -> None:
    info = {
        "looks": [[3.0, 8.0], [5.0, 10.0]],
        "reachable": [True, False],
        "limits": ["The pose can be reached.", "frame_tip misses by 3.8 mm."],
    }
    result = SeedResult(0)
    evaluate_taught(load_specimen("sopra"), (replace(posed(), info=info),), result)
    assert result.notes[-1] == "Of the poses, 2: frame_tip misses by 3.8 mm."


def test_poses_of_two_hands_are_joined() -> None:
    one = TeachResult(np.array([[1.0]]), np.array([[0.1]]), np.array([[0.5, 0.1]]), 1)
    other = TeachResult(np.array([[5.0, 6.0]]), np.array([[0.1, 0.2]]), np.array([[4.0, 0.1], [0.3, 0.2]]), 1)
    both = one.joined(other)
    assert both.reachable == 2
    np.testing.assert_array_equal(both.millimetres, [[1.0, 5.0, 6.0]])
    np.testing.assert_array_equal(both.near, [True, False, True])
    assert "3 poses with lateral hand motion" in both.note("lateral")
    assert "0.5, 4.0, 0.3 mm away" in both.note("lateral")


def test_a_pose_is_as_far_out_of_reach_as_its_section_is() -> None:
    goal = Frames(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    near = Frames(np.array([[1.0, 0.0, 0.0], [0.0, 0.003, 0.004]]), goal.rotations)
    assert out_of_reach(goal, near) == pytest.approx((5.0, 0.0))
    assert np.isnan(out_of_reach(goal, None)).all()


def test_after_the_cord_is_let_go_nothing_pulls_in_its_last_direction() -> None:
    off, lost = np.zeros(3), np.full(3, np.nan)
    pull = GaugePull(
        "tip",
        np.array([lost, [0.3, 0.0, 0.0], [0.0, 0.2, 0.0], lost, off]),
        np.array([off, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], off, off]),
    )
    released = pull.released()
    assert released.tied.tolist() == [False, True, True, True, True]
    np.testing.assert_array_equal(released.lateral[2:], np.tile([0.0, 1.0, 0.0], (3, 1)))
    np.testing.assert_array_equal(released.force[3:], 0.0)
