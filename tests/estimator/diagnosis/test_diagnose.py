from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.report import report_of
from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis import diagnose as whole
from softarm.estimator.diagnosis.candidates import ChosenEffects
from softarm.estimator.diagnosis.diagnose import DiagnosisOutcome, assemble, begin, diagnose, settled
from softarm.estimator.diagnosis.held_out import error_over_expected
from softarm.estimator.diagnosis.innovations import (
    channel_errors,
    learnt_coefficients,
    residuals_of,
    residuals_out_of_fold,
)
from softarm.estimator.diagnosis.judge import CERTAIN
from softarm.estimator.diagnosis.motion import HELDOUT, residual_column
from softarm.estimator.diagnosis.prepare import blocks_of
from softarm.estimator.diagnosis.recent import Recent
from softarm.estimator.diagnosis.session import Session, channels
from softarm.estimator.diagnosis.split import hold_out
from softarm.estimator.diagnosis.unnamed import UnnamedLaw
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import LOCKING, model, session, trial

TRIED = (
    "chamber_gain",
    "line_leak",
    "segment_stiffness",
    "sensor_scale",
    "sensor_bias",
    "pressure_bias",
)
WEAK = ("chamber_gain", Place(chamber=1), (-0.15,))
REST = ("viscoelastic_creep", "hysteresis", "line_leak")
RUNS, CREEPING = trial([])[2:], trial([("viscoelastic_creep", Place(), (0.3, 5.0, 0.0))])[2:]
"""Recordings in question of an arm that creeps by 2 %, and by as much as 32 %."""


def _diagnose(sessions: list[Session]) -> DiagnosisOutcome:
    return diagnose(model(), sessions, Inline(), effects=TRIED)


@pytest.fixture(scope="module")
def weak_sessions() -> list[Session]:
    return trial([WEAK])


@pytest.fixture(scope="module")
def weak(weak_sessions: list[Session]) -> DiagnosisOutcome:
    return _diagnose(weak_sessions)


def test_nothing_new_is_consistent() -> None:
    found = _diagnose(trial([])).diagnosis
    assert found.verdict == "consistent"
    assert not found.findings


def _seven_samples(seed: int) -> Session:
    """Cut a recording to seven samples."""
    run = session("run", seed)
    short = run.thin(np.isin(np.arange(run.samples), 100 + 20 * np.arange(7)))
    return replace(short, blocks=blocks_of(short.clock))


@pytest.mark.parametrize("seed", range(23, 30))
def test_what_a_few_samples_leave_open_is_no_missing_physics(seed: int) -> None:
    found = _diagnose([_seven_samples(seed)]).diagnosis
    assert found.verdict == "consistent"
    assert found.heldout.after > 1.0  # the prediction is uncertain, and says so


def test_the_remaining_error_is_weighed_by_its_covariance() -> None:
    search = begin(assemble(model(), [_seven_samples(24)], Inline(), TRIED).evidence, fast=True)
    (stage,), (columns,) = search.evidence.stages, search.evidence.columns
    confirming = stage.session.heldout & ~stage.session.reported
    learnt = search.left(None).folds.whole
    floor = np.array([search.evidence.floors[name] for name in channels(stage.suite)])
    noise = (floor * stage.compliance[:, None])[confirming]
    left = (stage.residual - columns @ learnt.mean)[confirming] / noise
    change = (columns[confirming] / noise[..., None]).reshape(left.size, -1)
    unknown = np.linalg.inv(learnt.fraction * learnt.data.matrix + learnt.prior.precision)
    covariance = np.eye(left.size) + change @ unknown @ change.T
    expected = np.sqrt(left.ravel() @ np.linalg.solve(covariance, left.ravel()) / left.size)
    assert error_over_expected(search, None) == pytest.approx(expected, rel=1e-3)


def test_a_weak_chamber_is_named_and_placed(weak: DiagnosisOutcome) -> None:
    (finding,) = weak.diagnosis.findings
    assert weak.diagnosis.verdict == "explained"
    assert (finding.effect, finding.where) == ("chamber_gain", Place(chamber=1))
    gain = finding.parameters["gain"]
    assert gain.value == pytest.approx(-0.15, abs=max(3.0 * gain.std, 0.015))
    assert finding.evidence.heldout_gain_ci95[0] > 0.0
    assert finding.probability is not None
    # A leak that has reached its end at once is a lost gain: nothing here makes either likelier.
    assert finding.probability == pytest.approx(0.5, abs=0.01)
    assert [rival.effect for rival in finding.confusable_with] == ["line_leak"]
    assert weak.diagnosis.heldout.after < weak.diagnosis.heldout.before


def test_a_weak_chamber_is_found_without_an_axis_of_a_sensor(weak_sessions: list[Session]) -> None:
    def blind(session: Session) -> Session:
        readings = session.readings.copy()
        readings[:, 2] = np.nan
        return replace(session, readings=readings)

    (finding,) = _diagnose([blind(session) for session in weak_sessions]).diagnosis.findings
    assert (finding.effect, finding.where) == ("chamber_gain", Place(chamber=1))


def test_a_name_is_as_probable_as_that_it_is_in_the_library(
    monkeypatch: pytest.MonkeyPatch, weak_sessions: list[Session], weak: DiagnosisOutcome
) -> None:
    law = UnnamedLaw(0.0, 1.0, 0.4, (), Place(), "")
    monkeypatch.setattr(whole, "unnamed_law", lambda *_: law)
    (shared,), (alone,) = _diagnose(weak_sessions).diagnosis.findings, weak.diagnosis.findings
    assert alone.probability is not None
    assert shared.probability == pytest.approx(0.6 * alone.probability, abs=0.02)


def test_recordings_in_question_are_kept_with_poses_and_residuals(
    weak: DiagnosisOutcome, weak_sessions: list[Session]
) -> None:
    diagnosis = weak.diagnosis
    assert tuple(one.name for one in diagnosis.motions) == diagnosis.recordings
    for channel, error in diagnosis.heldout.channels.items():
        for which, expected in (("before", error.before), ("after", error.after)):
            column = residual_column(which, channel, error.unit)
            unseen = [one.columns[column][one.columns[HELDOUT] == 1.0] for one in diagnosis.motions]
            assert np.sqrt(np.nanmean(np.concatenate(unseen) ** 2)) == pytest.approx(expected)
    begins = {session.name: session.time[0] for session in weak_sessions}
    for motion in diagnosis.motions:
        assert motion.time[0] == begins[motion.name]
        assert np.linalg.norm(motion.stack(("estimate_frame_tip_qw", "estimate_frame_tip_qx")), axis=1).all()
        assert {"pressure_0_pa", "bend_tip_x_rad"} <= set(motion.columns)


def test_traces_are_off_by_what_held_out_errors_count(weak: DiagnosisOutcome) -> None:
    kept = {one.name: one.columns for one in weak.diagnosis.motions}
    assert weak.diagnosis.traces
    for trace in weak.diagnosis.traces:
        for which, predicted in (("before", trace.before), ("after", trace.after)):
            residual = kept[trace.recording][residual_column(which, trace.channel, trace.unit)]
            np.testing.assert_allclose(trace.measured - predicted, residual, atol=1e-12)
        np.testing.assert_array_equal(trace.heldout, kept[trace.recording][HELDOUT] == 1.0)


def test_an_inseparable_rival_is_named_with_what_would_tell(weak: DiagnosisOutcome) -> None:
    (finding,) = weak.diagnosis.findings
    named = {rival.effect: rival.manoeuvre for rival in finding.confusable_with}
    assert "close the valve" in named.get("line_leak", "close the valve")


def test_the_mismatch_is_located_before_any_hypothesis(weak: DiagnosisOutcome) -> None:
    best = weak.diagnosis.map.best
    assert best is not None
    assert best.p_value < 0.05
    assert (best.kind, best.name) in (("chamber", "1"), ("segment", "upper"), ("base", "base"))


def test_a_sensor_that_shows_too_much_is_named_or_offered_beside_a_soft_segment() -> None:
    """A bend sensor on a segment shows the same when it shows too much as when the segment is soft."""
    effect = ("sensor_scale", Place(sensor="bend_tip"), (0.12,))
    (finding,) = _diagnose(trial([effect])).diagnosis.findings
    named = {
        finding.effect: finding.where,
        **{rival.effect: rival.where for rival in finding.confusable_with},
    }
    assert named["sensor_scale"] == Place(sensor="bend_tip")
    assert set(named) <= {"sensor_scale", "segment_stiffness"}


def test_confirming_data_can_only_take_a_finding_back(
    weak: DiagnosisOutcome, weak_sessions: list[Session]
) -> None:
    """No fit sees them: where they do not show the effect, it is found, and then not proven."""
    unchanged = trial([])
    split, _ = hold_out(weak_sessions, np.array(model().specimen.pressure_limits))
    held = {s.name: s.heldout & ~s.reported for s in split}
    held = {name: flags for name, flags in held.items() if flags.any()}
    assert held
    without = [
        replace(s, readings=np.where(held[s.name][:, None], u.readings, s.readings)) if s.name in held else s
        for s, u in zip(weak_sessions, unchanged, strict=True)
    ]
    again = _diagnose(without)
    (found,) = weak.accepted
    assert not again.accepted
    assert any("not proven" in note and found.effect.name in note for note in again.diagnosis.notes)


def test_without_nominal_recordings_only_what_recordings_show_for_certain_is_found() -> None:
    """Every arm creeps a little, as this one does by 2 %; by 30 % is something that the model left out."""
    little, much = (diagnose(model(), runs, Inline(), effects=REST).diagnosis for runs in (RUNS, CREEPING))
    assert not little.findings
    (finding,) = much.findings
    assert finding.effect == "viscoelastic_creep"
    strength = finding.parameters["strength"]
    assert strength.value == pytest.approx(0.32, abs=2.0 * strength.std)
    assert much.heldout.after < 0.1 * much.heldout.before


def test_what_is_suspected_and_not_found_is_what_any_arm_may_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that refuses to name the creep of an arm predicts it as well as one that does."""
    evidence = assemble(model(), CREEPING, Inline(), REST).evidence
    named, decision = settled(evidence, fast=True)
    assert named.suspected == decision.names == {"viscoelastic_creep"}
    nothing = replace(decision, choice=ChosenEffects((), None, 1.0, None))
    monkeypatch.setattr(whole, "decide", lambda _: nothing)
    refused, _ = settled(evidence, fast=True)
    assert not refused.suspected
    errors = []
    for search, fit in ((named, decision.choice.fit), (refused, None)):
        left = residuals_of(search, fit, learnt_coefficients(search, fit))
        errors.append(np.mean([one.after for one in channel_errors(search, left, left).values()]))
    assert errors[1] < 1.5 * errors[0]


def test_stretches_are_predicted_by_other_folds_alone() -> None:
    """Whatever a stretch shows changes what is left of it as much as it changes its readings."""
    search = begin(assemble(model(), RUNS, Inline(), REST).evidence, fast=True)
    evidence, part = search.evidence, search.left(None).parts[0]
    assert not part.heldout
    chosen = evidence.stages[part.session].session.blocks == part.block
    moved = [residual.copy() for residual in evidence.residuals]
    moved[part.session][chosen] += 0.01 * evidence.columns[part.session][chosen][..., 0]
    other = replace(search, evidence=replace(evidence, residuals=tuple(moved), kept={}), remainders=Recent(1))
    before, after = (residuals_out_of_fold(one, None)[part.session] for one in (search, other))
    by = moved[part.session] - evidence.residuals[part.session]
    assert (after - before)[chosen] == pytest.approx(by[chosen], abs=1e-9)
    assert np.abs((after - before)[~chosen]).max() > 1e-6


def test_reported_data_decide_nothing(weak: DiagnosisOutcome, weak_sessions: list[Session]) -> None:
    """Whatever they show, the verdict and the findings are the same; only their errors tell."""
    split, _ = hold_out(weak_sessions, np.array(model().specimen.pressure_limits))
    off = [
        replace(one, readings=one.readings + 0.05 * cut.reported[:, None])
        for one, cut in zip(weak_sessions, split, strict=True)
    ]
    again = _diagnose(off)
    assert any(cut.reported.any() for cut in split)
    assert again.diagnosis.verdict == weak.diagnosis.verdict
    assert [one.theta.tolist() for one in again.accepted] == [one.theta.tolist() for one in weak.accepted]
    assert again.diagnosis.heldout.after > 10.0 * weak.diagnosis.heldout.after


def test_one_seed_gives_one_report(weak: DiagnosisOutcome) -> None:
    again = _diagnose(trial([WEAK]))
    assert report_of(again.diagnosis) == report_of(weak.diagnosis)


def test_an_effect_is_found_that_another_one_had_taken_in() -> None:
    """Alone, creep takes in what a sensor reads too little, with more strength and a longer time."""
    creep = ("viscoelastic_creep", Place(segment="lower"), (0.19, 8.0, 1.0))
    scale = ("sensor_scale", Place(sensor="bend_tip"), (-0.1,))
    tried = ("viscoelastic_creep", "sensor_scale", "segment_stiffness", "chamber_gain", "hysteresis")
    found = diagnose(model(), trial([creep, scale]), Inline(), effects=tried).diagnosis.findings
    sizes = {finding.effect: finding.parameters for finding in found}
    assert set(sizes) == {"viscoelastic_creep", "sensor_scale"}
    assert sizes["sensor_scale"]["scale"].value == pytest.approx(-0.1, abs=0.01)
    assert sizes["viscoelastic_creep"]["strength"].value == pytest.approx(0.19, abs=0.03)
    assert sizes["viscoelastic_creep"]["time_constant"].value == pytest.approx(8.0, abs=1.0)


def test_recordings_that_disagree_get_no_finding() -> None:
    """Half of them show a weak chamber, the others one that is as much too strong."""
    known = trial([])[:2]
    signs = [-1.0, 1.0, -1.0, 1.0]
    runs = [
        session(f"run_{k}", 10 + k, [("chamber_gain", Place(chamber=1), (0.15 * sign,))])
        for k, sign in enumerate(signs)
    ]
    found = _diagnose([*known, *runs]).diagnosis
    assert {finding.effect for finding in found.findings} <= {"unknown"}
    assert found.verdict == "unexplained" or found.heldout.after >= found.heldout.before


def test_a_structure_outside_the_library_is_unknown() -> None:
    sessions = trial([])
    shaken = []
    for one in sessions:
        ripple = 0.06 * np.sin(2.0 * np.pi * one.clock / 2.3)[:, None] * np.array([1.0, 0.0, 0.0, 0.0])
        shaken.append(one if one.nominal else replace(one, readings=one.readings + ripple))
    found = _diagnose(shaken).diagnosis
    assert found.verdict in ("unexplained", "partly_explained")
    assert [finding.effect for finding in found.findings] == ["unknown"] or found.verdict != "unexplained"
    assert found.unexplained.over_nominal is not None
    assert found.unexplained.over_nominal > whole.STRUCTURE


def test_an_obstacle_is_found_where_nominal_runs_hardly_were() -> None:
    """No arm has a wall of itself: that they never met one says nothing about what every arm may have."""
    wall = ("contact_obstacle", Place(section="tip"), (300.0, 0.03, 0.5))
    tried = ("chamber_gain", "segment_stiffness", "sensor_scale", "contact_obstacle", "material_stiffening")
    (finding,) = diagnose(model(), trial([wall]), Inline(), effects=tried).diagnosis.findings
    assert (finding.effect, finding.where) == ("contact_obstacle", Place(section="tip"))
    assert finding.parameters["distance"].value == pytest.approx(0.03, abs=0.005)
    assert finding.parameters["azimuth"].value == pytest.approx(0.5, abs=0.2)


def test_a_segment_that_locks_is_not_called_one_that_stiffens() -> None:
    """Both bend less the further they bend; only one of the two laws is in the library."""
    tried = (*TRIED, "material_stiffening", "material_softening")
    lower = Place(segment="lower")
    sizes = {"material_stiffening": (2.0,), LOCKING: (0.3, 0.7)}
    found = {
        effect: diagnose(model(), trial([(effect, lower, theta)]), Inline(), effects=tried).diagnosis
        for effect, theta in sizes.items()
    }
    assert [f.effect for f in found["material_stiffening"].findings] == ["material_stiffening"]
    (finding,) = found[LOCKING].findings
    assert found[LOCKING].verdict == "unexplained"
    assert (finding.effect, finding.where, finding.when) == ("unknown", lower, "pose")
    assert finding.probability is not None
    assert finding.probability > 0.9
    assert "acts at the lower segment and depends on the pose." in finding.statement


def test_physics_that_is_not_tried_leaves_something_unexplained() -> None:
    """No effect of the library stands out, but nominal runs do not differ from one another so much."""
    found = _diagnose(trial([("hysteresis", Place(), (0.25, 0.1, 0.0, 0.0))])).diagnosis
    assert found.verdict in ("unexplained", "partly_explained")


@pytest.mark.parametrize("known", [True, False])
def test_what_an_arm_had_at_its_own_shape_is_no_gain_of_an_effect(*, known: bool) -> None:
    """Friction over a hundredth of a radian is unlike what the library's shapes stand for."""
    friction = ("hysteresis", Place(), (0.9, 0.01, 0.0, 0.0))
    sessions = [
        *(session(f"nominal_{k}", k, [friction] if known else [], nominal=True) for k in range(2)),
        *(session(f"run_{k}", 10 + k, [friction]) for k in range(4)),
    ]
    search = begin(assemble(model(), sessions, Inline(), ("hysteresis", "chamber_gain")).evidence, fast=False)
    (number,) = (
        k for k, h in enumerate(search.evidence.library.hypotheses) if (h.name, h.place) == friction[:2]
    )
    theta = np.array(friction[2])
    candidate = search.candidate(number, theta, search.problem(), None)
    assert candidate is not None
    assert (candidate.delta_bic < 0.0) if known else (candidate.delta_bic > CERTAIN)
