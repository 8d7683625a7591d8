"""Calibration of a toy arm whose moduli, gains and axes are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, stdtrit
from synthetic import GAINS, SCALES, record, record_pulls, true_specimen
from toy import toy

from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import (
    Calibrated,
    CalibrationRefusedError,
    CalibrationRun,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
    check_drift,
    section_forces,
)
from softarm.estimator.calibration.fit import fit, left_out
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import build_layout
from softarm.estimator.calibration.nodes import choose_nodes
from softarm.estimator.calibration.pulls import known_pulls
from softarm.estimator.calibration.regression import estimate_lag
from softarm.estimator.calibration.setting import Setting, gravity_axes
from softarm.estimator.calibration.unknowns import Modulus, by_azimuth
from softarm.estimator.calibration.unpulled import unpulled_errors
from softarm.estimator.calibration.warm_start import nearest_states
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import ActuationMap, Registration
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.specimen import Specimen, Value, load_specimen

SECTIONS = ("base", "intermediate", "tip")
PLANE = 0.5 * stdtrit(4, ndtr(2.0)) / np.sqrt(2.0)
"""Stated over actual relative error of two pulls that err along themselves alone."""
QUICK = Options(nodes=40, iterations=8)


@pytest.fixture(scope="module")
def sopra() -> Specimen:
    return load_specimen("sopra")


@pytest.mark.parametrize("mirrored", [False, True])
def test_finds_moduli_gains_and_axes_wherever_they_point(sopra: Specimen, mirrored: bool) -> None:
    found = calibrate(
        SequentialBatchModel(toy()), sopra, [arrange(record(mirrored=mirrored), sopra, SECTIONS)], QUICK
    )
    after = calibrated_specimen(sopra, found).calibration
    truth = true_specimen(mirrored).calibration
    for name, scale in SCALES.items():
        value = after.modulus_scale[name]
        assert abs(value.value - scale) < 3 * value.std + 0.01
        assert value.std < 0.1
    assert [entry.gain.value for entry in after.chambers] == pytest.approx(GAINS, abs=0.01)
    for section in ("intermediate", "tip"):
        assert after.bend(section).mirrored is mirrored
        assert after.bend(section).rotation_rad.value == pytest.approx(
            truth.bend(section).rotation_rad.value, abs=0.01
        )
        assert after.bend(section).bias_x_rad.value == pytest.approx(
            truth.bend(section).bias_x_rad.value, abs=3e-3
        )
    assert after.recordings == ("toy",)
    assert all(found.check.held_out[name] < 0.05 * found.check.before[name] for name in found.check.held_out)


@pytest.mark.parametrize("section", ["intermediate", "tip"])
def test_one_bend_may_have_the_other_handedness(sopra: Specimen, section: str) -> None:
    plain = record(mirrored=False)
    name = f"bend_{section}_x_rad"
    flipped = replace(plain, columns={**plain.columns, name: -plain.columns[name]})
    found = calibrate(SequentialBatchModel(toy()), sopra, [arrange(flipped, sopra, SECTIONS)], QUICK)
    assert found.mirrored == {one: one == section for one in ("intermediate", "tip")}
    assert all(found.check.held_out[one] < 0.05 * found.check.before[one] for one in found.check.held_out)


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_axis_of_a_bend_that_was_never_read_changes_no_calibration(
    sopra: Specimen, mirrored: bool
) -> None:
    recording = record(mirrored=mirrored)
    lost = np.full(len(recording.time), np.nan)
    blind = replace(recording, columns={**recording.columns, "bend_tip_x_rad": lost})
    found = calibrate(SequentialBatchModel(toy()), sopra, [arrange(blind, sopra, SECTIONS)], QUICK)
    after = calibrated_specimen(sopra, found).calibration
    truth = true_specimen(mirrored).calibration
    for name, scale in SCALES.items():
        assert abs(after.modulus_scale[name].value - scale) < 3 * after.modulus_scale[name].std + 0.01
    for section in ("intermediate", "tip"):
        assert after.bend(section).mirrored is mirrored
        assert after.bend(section).rotation_rad.value == pytest.approx(
            truth.bend(section).rotation_rad.value, abs=0.02
        )


def calibrated_by_pulls(sopra: Specimen, *recordings: Recording) -> Calibrated:
    loads = section_forces(sopra)
    runs = [arrange(one, sopra, SECTIONS, loads) for one in recordings]
    return calibrate(SequentialBatchModel(toy(loads)), sopra, runs, QUICK)


def test_the_moduli_rest_on_every_pull(sopra: Specimen) -> None:
    """The fit that is checked sees alternate recordings; what it gives out has seen all of them."""
    pulls = (record_pulls((stiffer,), 9.5) for stiffer in (1.0, 1.06))
    after = calibrated_specimen(sopra, calibrated_by_pulls(sopra, *pulls, record(9.5, noise=1e-3)))
    for name, scale in SCALES.items():
        assert after.calibration.scale(name) == pytest.approx(1.03 * scale, rel=0.015)


def test_forces_are_judged_by_pulls_that_the_fit_has_not_seen(sopra: Specimen) -> None:
    """Of two unlike pulls, blocks that are held out err by half of the difference, an unseen pull by all."""
    found = calibrated_by_pulls(sopra, record_pulls((1.0, 1.1), 60.0), record(20.0, noise=1e-3))
    assert found.force_error["vented pulls on tip"] == pytest.approx(0.1 * PLANE, rel=0.25)


def test_a_force_where_nobody_pulled_is_as_uncertain_as_the_modulus_above_it(sopra: Specimen) -> None:
    found = calibrated_by_pulls(sopra, record_pulls((1.0, 1.1), 60.0), record(20.0, noise=1e-3))
    modulus = found.value("modulus.upper")
    assert modulus is not None
    expected = np.hypot(modulus.std / modulus.value, found.force_error["vented pulls on tip"])
    assert found.force_error["vented pulls on intermediate"] == pytest.approx(expected, rel=0.3)
    assert calibrated_specimen(sopra, found).calibration.force_error == found.force_error


def test_sections_that_may_be_softer_than_drawn_make_a_force_on_them_less_certain(
    sopra: Specimen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pull on the tip bends the section between the segments, a force on that section does not."""
    loads = section_forces(sopra)
    elements = SequentialBatchModel(build_arm(sopra, loads=loads))
    nodes = choose_nodes(arrange(record_pulls((1.0,), 30.0), sopra, SECTIONS, loads), 8)
    layout = build_layout(
        sopra, nodes.run.suite, nodes.run.pressure_source, range(6), elements.regions, True, SECTIONS
    )
    layout = layout.without({u.name for u in layout.unknowns if not isinstance(u, Modulus)})
    setting = layout.setting(layout.means)
    frames = Forward(elements, layout, (nodes,)).predict(setting, nodes).response.frames
    exact = replace(nodes, readings=setting.aligned(nodes.run.suite).predict(frames))
    forward = Forward(elements, layout, (exact,))
    solution = fit(forward, layout.means, iterations=1)
    (open_sections,) = unpulled_errors(forward, solution, {"vented pulls on tip": 0.0}, {}).values()
    monkeypatch.setattr("softarm.estimator.calibration.unpulled.MODULUS_SPREAD", 1e-6)
    (drawn_sections,) = unpulled_errors(forward, solution, {"vented pulls on tip": 0.0}, {}).values()
    assert 2.0 * drawn_sections < open_sections < 0.05


def test_held_out_blocks_are_predicted_as_well_as_by_a_line_with_more_parameters(sopra: Specimen) -> None:
    found = calibrate(SequentialBatchModel(toy()), sopra, [arrange(record(), sopra, SECTIONS)], QUICK)
    assert found.fitted < found.check.line_parameters == 28
    model, line = (np.array(list(part.values())) for part in (found.check.held_out, found.check.line))
    assert np.sqrt((model**2).mean()) < 1.1 * np.sqrt((line**2).mean())


def test_poses_give_misalignment_and_offset(sopra: Specimen) -> None:
    run = arrange(record(kinds=("frame",)), sopra, SECTIONS)
    after = calibrated_specimen(
        sopra, calibrate(SequentialBatchModel(toy()), sopra, [run], QUICK)
    ).calibration
    truth = true_specimen().calibration.frame("tip")
    assert after.frame("tip").misalignment_rad == pytest.approx(truth.misalignment_rad, abs=0.01)
    assert after.frame("tip").offset_m == pytest.approx(truth.offset_m, abs=1e-3)
    assert after.scale("upper") == pytest.approx(0.7, abs=0.05)


def test_what_is_not_excited_is_named_and_kept(sopra: Specimen) -> None:
    found = calibrate(
        SequentialBatchModel(toy()), sopra, [arrange(record(chambers=(0, 1, 2)), sopra, SECTIONS)], QUICK
    )
    verdicts = {entry.unknown.name: entry for entry in found.identified}
    assert verdicts["modulus.lower"].verdict == "kept"
    assert "hold the arm still" in verdicts["modulus.lower"].manoeuvre
    assert verdicts["modulus.upper"].verdict == "determined"
    assert "gain.3" not in verdicts
    after = calibrated_specimen(sopra, found)
    assert "lower" not in after.calibration.modulus_scale
    assert after.calibration.chamber(4).gain.value == 1.0


def test_an_arm_at_rest_is_refused(sopra: Specimen) -> None:
    still = record(chambers=(0,), duration=15.0)
    still = Recording(still.name, still.time, {**still.columns, "pressure_0_pa": 0.0 * still.time})
    with pytest.raises(CalibrationRefusedError, match="neither a modulus nor a gain; hold the arm still"):
        calibrate(SequentialBatchModel(toy()), sopra, [arrange(_at_rest(still), sopra, SECTIONS)], QUICK)


def _at_rest(recording: Recording) -> Recording:
    columns = {
        name: np.full_like(v, v[0]) if name.startswith("bend") else v for name, v in recording.columns.items()
    }
    return Recording(recording.name, recording.time, columns)


def test_a_second_calibration_changes_nothing(sopra: Specimen) -> None:
    run = arrange(record(), sopra, SECTIONS)
    once = calibrated_specimen(sopra, calibrate(SequentialBatchModel(toy()), sopra, [run], QUICK))
    again = arrange(record(), once, SECTIONS)
    twice = calibrated_specimen(once, calibrate(SequentialBatchModel(toy()), once, [again], QUICK))
    for name in SCALES:
        assert twice.calibration.scale(name) == pytest.approx(once.calibration.scale(name), rel=0.02)
    assert twice.calibration.recordings == ("toy",)


def test_several_short_runs_hold_out_every_other_one(sopra: Specimen) -> None:
    runs = [arrange(record(duration=9.0, seed=seed), sopra, SECTIONS) for seed in range(4)]
    found = calibrate(SequentialBatchModel(toy()), sopra, runs, QUICK)
    assert found.check.held_out
    assert found.value("modulus.upper") is not None


def test_outliers_do_not_move_it(sopra: Specimen) -> None:
    recording = record()
    columns = dict(recording.columns)
    spoilt = columns["bend_tip_x_rad"].copy()
    spoilt[200:280] += 1.0
    run = arrange(Recording("toy", recording.time, {**columns, "bend_tip_x_rad": spoilt}), sopra, SECTIONS)
    after = calibrated_specimen(
        sopra, calibrate(SequentialBatchModel(toy()), sopra, [run], QUICK)
    ).calibration
    assert after.bend("tip").rotation_rad.value == pytest.approx(-1.0, abs=0.02)
    assert after.scale("lower") == pytest.approx(1.4, rel=0.05)


def finely_calibrated(plain: Specimen) -> Specimen:
    """Return a specimen in which everything that acts on a pressure does something."""
    chambers = tuple(
        plain.calibration.chamber(k).model_copy(
            update={
                "curve_per_pa": Value(value=-2e-6),
                "quadratic_gain_per_pa2": Value(value=4e-11),
                "crosstalk": tuple(0.02 * (k != other) for other in range(6)),
            }
        )
        for k in range(6)
    )
    found = plain.calibration.model_copy(update={"stretch_gain": Value(value=0.8), "chambers": chambers})
    return plain.model_copy(update={"calibration": found})


def test_jacobian_agrees_with_finite_differences(sopra: Specimen) -> None:
    nodes = choose_nodes(arrange(record(kinds=("bend", "frame")), true_specimen(), SECTIONS), 5)
    layout = build_layout(
        finely_calibrated(true_specimen()),
        nodes.run.suite,
        nodes.run.pressure_source,
        range(6),
        ("upper", "lower"),
        pulled=True,
        sections=SECTIONS,
    )
    assert {"stretch", "quadratic_gain.upper", "crosstalk.0.5"} < set(layout.names)
    forward = Forward(SequentialBatchModel(toy()), layout, (nodes,))
    (at,) = forward.evaluate(layout.means, forward.evaluate(layout.means))
    for index, unknown in enumerate(layout.unknowns):
        size = 1e-5 * unknown.spread
        ends = []
        for sign in (-1, 1):
            moved = layout.means.copy()
            moved[index] += sign * size
            ends.append(forward.evaluate(moved, (at,))[0].innovation)
        slope = (ends[0] - ends[1]) / (2 * size)
        largest = max(float(np.abs(slope).max()), 1e-9)
        assert np.abs(at.jacobian[:, :, index] - slope).max() < 2e-3 * largest, unknown.name


def test_each_run_is_solved_under_its_own_gravity(sopra: Specimen) -> None:
    """A recording of a turned mount says so; without a word the mount is the specimen's."""
    seen: list[np.ndarray] = []

    class Weighed(SequentialBatchModel):
        def evaluate(self, inputs, **options):
            seen.append(inputs.gravity)
            return super().evaluate(inputs, **options)

    usual = record()
    turned = replace(usual, info={**usual.info, "gravity_m_s2": [9.81, 0.0, 0.0]})
    nodes = tuple(choose_nodes(arrange(one, sopra, SECTIONS), 3) for one in (usual, turned))
    run = nodes[0].run
    layout = build_layout(sopra, run.suite, run.pressure_source, range(6), ("upper", "lower"))
    Forward(Weighed(toy()), layout, nodes).evaluate(layout.means)
    np.testing.assert_allclose(seen, [[0.0, 0.0, 9.81], [9.81, 0.0, 0.0]])
    tilted = layout.means
    tilted[layout.names.index("gravity.tilt_y")] = 0.1
    Forward(Weighed(toy()), layout, nodes).evaluate(tilted)
    # The tilt is one of the base frame: the same rotation acts on gravity in both mounts.
    both = np.array(seen[2:])
    np.testing.assert_allclose(both[0] @ both[1], 0.0, atol=1e-9)
    assert abs(both[0, 0] - both[0, 1]) == pytest.approx(9.81 * np.sin(0.1))


def test_held_out_nodes_begin_at_the_state_of_the_most_similar_solved_node(sopra: Specimen) -> None:
    """With moduli that the fit has changed much, a node's own old state is far from its equilibrium."""
    nodes = choose_nodes(arrange(record(), sopra, SECTIONS), 12)
    layout = build_layout(sopra, nodes.run.suite, nodes.run.pressure_source, range(6), ("upper", "lower"))
    train = np.arange(12) % 2 == 0
    seen, unseen = nodes.keep(train), nodes.keep(~train)
    (solved,) = Forward(SequentialBatchModel(toy()), layout, (seen,)).evaluate(layout.means)
    solved.response.states[:] = range(6)
    near = nearest_states((solved,), (seen,), (solved,), (unseen,))
    size = np.ptp(seen.pressures, axis=0)
    apart = np.linalg.norm((unseen.pressures[:, None] - seen.pressures) / size, axis=2)
    assert near[0].response.states.tolist() == apart.argmin(axis=1).tolist()
    assert near[0].converged.all()
    # Of an arm without chambers that nobody pulls, gravity is all that bends it.
    bare = [
        replace(part, pressures=part.pressures[:, :0], loads=part.loads[:, :0]) for part in (seen, unseen)
    ]
    (near_bare,) = nearest_states((solved,), bare[:1], (solved,), bare[1:])
    assert near_bare.converged.all()


@pytest.mark.parametrize("lag", [-0.1, 0.0, 0.15])
@pytest.mark.parametrize("lost", [(), (2,)])
def test_the_lag_between_the_clocks_is_found(sopra: Specimen, lag: float, lost: tuple[int, ...]) -> None:
    run = arrange(record(lag=lag, rate=50.0), sopra, SECTIONS)
    run.readings[:, list(lost)] = np.nan
    assert estimate_lag(run) == pytest.approx(lag, abs=0.02)


def test_a_fit_reports_when_it_runs_out_of_iterations(sopra: Specimen) -> None:
    nodes = choose_nodes(arrange(record(), sopra, SECTIONS), 10)
    layout = build_layout(sopra, nodes.run.suite, nodes.run.pressure_source, range(6), ("upper", "lower"))
    found = fit(Forward(SequentialBatchModel(toy()), layout, (nodes,)), layout.means, iterations=1)
    assert found.status == "iterations_exhausted"
    assert found.iterations == 1


def test_a_fit_ends_when_its_steps_gain_nothing(sopra: Specimen, monkeypatch) -> None:
    nodes = choose_nodes(arrange(record(), sopra, SECTIONS), 20)
    layout = build_layout(sopra, nodes.run.suite, nodes.run.pressure_source, range(6), ("upper", "lower"))
    forward = Forward(SequentialBatchModel(toy()), layout, (nodes,))
    ended = fit(forward, layout.means, iterations=40, tolerance=0.0)
    assert ended.status == "converged"
    monkeypatch.setattr("softarm.estimator.calibration.fit.LEAST_GAIN", 0.0)
    longest = fit(forward, layout.means, iterations=40, tolerance=0.0)
    assert ended.iterations <= 12 < longest.iterations
    assert (np.abs(ended.values - longest.values) <= 0.5 * np.sqrt(np.diag(longest.covariance))).all()


CASES = {
    "more chambers": ({"pressure_6_pa": 1e4}, "the specimen has 6 chambers"),
    "over the limit": ({"pressure_0_pa": 8e4}, "80000 Pa is above the specimen's limit of 65000 Pa"),
    "foreign section": (
        {"bend_top_x_rad": 0.1, "bend_top_y_rad": 0.1},
        "no section 'top'; the nearest .* is tip",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_recording_that_does_not_fit_the_specimen(sopra: Specimen, case: str) -> None:
    more, message = CASES[case]
    base = record(duration=2.0)
    columns = {**base.columns, **{name: np.full(len(base.time), value) for name, value in more.items()}}
    with pytest.raises(InputError, match=message):
        arrange(Recording("toy", base.time, columns), sopra, SECTIONS)


def test_a_recording_without_motion(sopra: Specimen) -> None:
    time = np.arange(5.0)
    with pytest.raises(InputError, match="holds no motion of the arm"):
        arrange(Recording("toy", time, {"pressure_0_pa": time}), sopra, SECTIONS)


def test_streams_with_times_of_their_own_are_brought_together(sopra: Specimen) -> None:
    time = np.arange(0, 1, 0.01)
    slow = np.where(np.arange(100) % 2 == 0, 1e4 * time, np.nan)
    bends = np.where(np.arange(100) % 2 == 1, 0.1, np.nan)
    columns = {"pressure_0_pa": slow, "bend_tip_x_rad": bends, "bend_tip_y_rad": bends}
    run = arrange(Recording("toy", time, columns), sopra, SECTIONS)
    assert len(run.time) == 50
    assert run.pressures[:-1, 0] == pytest.approx(1e4 * run.time[:-1])


def test_a_calibration_goes_stale_when_the_arm_changes(sopra: Specimen) -> None:
    run = arrange(record(), sopra, SECTIONS)
    known = calibrated_specimen(sopra, calibrate(SequentialBatchModel(toy()), sopra, [run], QUICK), "a test")
    assert known.calibration.provenance == "a test"
    assert set(known.calibration.scatter) == {"bend_intermediate", "bend_tip"}
    solver = SequentialBatchModel(toy().with_scales({n: known.calibration.scale(n) for n in SCALES}))
    later = arrange(record(seed=5), known, SECTIONS)
    assert not any(drift.stale for drift in check_drift(solver, known, [later]))
    softened = {**later.__dict__, "pressures": 1.15 * later.pressures}
    drifts = check_drift(solver, known, [CalibrationRun(**softened)])
    assert all(drift.stale and drift.ratio > 1.3 for drift in drifts)


def test_a_specimen_that_was_never_calibrated_cannot_be_stale(sopra: Specimen) -> None:
    with pytest.raises(InputError, match="was never calibrated; run softarm calibrate"):
        check_drift(SequentialBatchModel(toy()), sopra, [arrange(record(), sopra, SECTIONS)])


def test_known_pulls_and_gravity_turn_as_told() -> None:
    setting = Setting(
        {}, ActuationMap(np.ones(1), np.zeros(1)), {}, gravity_tilt=np.array([0.0, 0.1]), cord_azimuth=0.3
    )
    down = np.array([0.0, 0.0, 9.81])
    axes = gravity_axes(down)
    np.testing.assert_allclose(axes @ np.column_stack([axes.T, down]), np.eye(2, 3), atol=1e-12)
    assert np.linalg.norm(setting.gravity(down)) == pytest.approx(9.81)
    assert np.arccos(setting.gravity(down) @ down / 9.81**2) == pytest.approx(0.1)
    pulls = np.array([[1.0, 0.0, 0.5, 0.0, 2.0, 0.0]])
    turned = setting.pulls(pulls)
    np.testing.assert_allclose(turned[0, :3], [np.cos(0.3), np.sin(0.3), 0.5])
    small = 1e-6
    ends = [
        Setting({}, ActuationMap(np.ones(1), np.zeros(1)), {}, cord_azimuth=a).pulls(pulls)
        for a in (-small, small)
    ]
    by_load = np.random.default_rng(0).normal(size=(1, 4, 6))
    slope = (by_load @ ((ends[1] - ends[0]) / (2 * small))[..., None])[..., 0]
    np.testing.assert_allclose(by_azimuth(by_load, pulls), slope, atol=1e-8)


def test_a_block_that_is_left_out_is_predicted_as_by_the_fit_to_all_others() -> None:
    known = true_specimen()
    nodes = choose_nodes(arrange(record(noise=0.02), known, SECTIONS), 40)
    regions, chambers = ("upper", "lower"), tuple(range(6))
    layout = build_layout(known, nodes.run.suite, nodes.run.pressure_source, chambers, regions)
    forward = Forward(SequentialBatchModel(toy()), layout, (nodes,))
    whole = fit(forward, layout.means)
    others = nodes.blocks != 1
    apart = fit(replace(forward, nodes=(nodes.keep(others),)), layout.means, scatter=whole.scatter)
    exact = forward.evaluate(apart.values)[0].innovation[~others]
    found, seen = (part[0].innovation[~others] for part in (left_out(forward, whole), whole.evaluations))
    assert np.abs(found - exact).max() < 0.3 * np.abs(seen - exact).max()


def test_a_cord_pulls_as_at_its_last_reading_until_it_is_let_go(sopra: Specimen) -> None:
    """A gauge that answers every fifth sample reads nothing just before the hook is gone."""
    time = 0.01 * np.arange(60)
    tied = time < 0.195
    reading = np.arange(60) % 5 == 0
    columns = {
        "gauge_tip_n": np.where(reading, np.where(tied, 0.4, 0.0), np.nan),
        "marker_hook_x_m": np.where(tied, 0.2, np.nan),
        "marker_hook_y_m": np.where(tied, 0.0, np.nan),
        "marker_hook_z_m": np.where(tied, 0.276, np.nan),
    }
    loads = section_forces(sopra)
    pulls = known_pulls(Recording("pulls", time, columns), sopra, Registration(), loads)
    along = pulls[:, [load.name for load in loads].index("tip_x")]
    np.testing.assert_allclose(along[15:20], 0.4)
    assert np.isnan(along[11:15]).all()
    assert along[20] == 0.0
