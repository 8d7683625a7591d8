"""What the intake of recordings adds to a diagnosis."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.intake import check_recordings, with_intakes, with_touches
from softarm.estimator.diagnosis.events import EventErrors
from softarm.estimator.diagnosis.result import Quantity
from softarm.estimator.errors import InputError
from softarm.estimator.intake import Disturbance, Intake, RecordingFault
from softarm.estimator.intake.unsteady import LEAST
from softarm.estimator.recording import Recording
from tests.estimator.intake import small_arm as arm
from tests.service.diagnosis.made_diagnosis import diagnosis

EVENT = Disturbance("run_03", (12.0, 16.0), ("bend_tip",), 0.1, 0.03, 0.01, 0.002, 0.99)
INTAKE = Intake(Recording("run_03", np.arange(5.0), {}), events=(EVENT,))


@pytest.mark.parametrize(
    ("nominal", "verdict", "reported"),
    [
        (("nominal_00",), "explained", True),
        (("nominal_00",), "consistent", True),
        (("nominal_00",), "unexplained", False),
        ((), "unexplained", True),
    ],
)
def test_beside_a_law_without_a_name_nobody_can_say_what_is_an_event(nominal, verdict, reported):
    found = with_intakes(replace(diagnosis(), nominal=nominal, verdict=verdict, findings=()), [INTAKE], ())
    assert [one.effect for one in found.findings] == (["event"] if reported else [])
    assert any(EVENT.statement in note for note in found.notes) != reported


@pytest.mark.parametrize(("error", "reported"), [(0.5, False), (2.0, True)])
def test_what_the_model_with_all_findings_predicts_is_no_event(error: float, reported: bool) -> None:
    """The recording began at 100 s of its session, so the event is at 112 to 116 s."""
    clock = np.arange(100.0, 130.0, 0.1)
    errors = np.full((len(clock), 1), error * LEAST["rad"])
    left = EventErrors("run_03", clock, errors, clock > 0.0, np.zeros_like(errors), np.zeros(1), ("rad",))
    late = replace(INTAKE, recording=replace(INTAKE.recording, info={"session_start_s": 100.0}))
    found = with_intakes(replace(diagnosis(), findings=()), [late], (), [left])
    assert [one.effect for one in found.findings] == (["event"] if reported else [])
    note = (
        f"{EVENT.statement} The model with all findings predicts it to within 1 degrees, so it is no event."
    )
    assert (note in found.notes) != reported


def test_what_laws_may_get_wrong_is_no_event():
    clock = np.arange(12.0, 16.0, 0.1)
    errors = np.full((len(clock), 1), 2.0 * LEAST["rad"])
    left = EventErrors("run_03", clock, errors, clock > 0.0, 0.9 * errors, np.zeros(1), ("rad",))
    found = with_intakes(replace(diagnosis(), findings=()), [INTAKE], (), [left])
    assert not found.findings
    assert any(
        "to within 4 degrees, no more than it and its findings may get wrong" in note for note in found.notes
    )


def test_where_an_arm_may_snap_through_by_itself_nobody_can_say_what_is_an_event():
    clock = np.arange(12.0, 16.0, 0.1)
    errors = np.full((len(clock), 1), np.nan)
    left = EventErrors("run_03", clock, errors, clock > 15.0, errors, np.zeros(1), ("rad",))
    found = with_intakes(replace(diagnosis(), findings=()), [INTAKE], (), [left])
    assert not found.findings
    assert any("no stable equilibrium there" in note for note in found.notes)


def test_touches_that_the_model_shows_join_the_events_that_the_intake_saw_in_part() -> None:
    """The recording began at 100 s of the clock by which the model goes, and a nominal one at 0."""
    late = replace(INTAKE, recording=replace(INTAKE.recording, info={"session_start_s": 100.0}))
    more = Disturbance("run_03", (115.0, 118.0), ("frame_tip",), 0.2, 0.02, 0.01, 0.0, 0.97, (3, 5e3))
    apart = replace(more, interval=(140.0, 144.0))
    known = replace(more, recording="nominal_00", interval=(7.0, 9.0))
    nominal = Recording("nominal_00", np.arange(5.0), {})
    (intake,), of_nominal = with_touches([late], [nominal], [apart, more, known])
    joined, other = intake.events
    assert joined == replace(
        more, interval=(12.0, 18.0), channels=("bend_tip", "frame_tip"), size_m=0.03, probability=0.99
    )
    assert other.interval == (40.0, 44.0)
    assert set(intake.excluded) == {(15.0, 18.0), (40.0, 44.0)}
    assert of_nominal == (known,)
    assert with_touches([INTAKE], [nominal], []) == ((INTAKE,), ())


def test_a_sensor_that_stands_still_in_several_recordings_is_one_finding():
    def stuck(run: str, since: float) -> Intake:
        cure = "it is stuck and left out for that time"
        fault = RecordingFault(run, "stuck", ("frame_tip",), "it stands still", cure, interval=(since, 40.0))
        return Intake(Recording(run, np.arange(5.0), {}), (fault,))

    intakes = [stuck("run_00", 20.5), stuck("run_01", 3.0)]
    (finding,) = with_intakes(replace(diagnosis(), findings=()), intakes, ()).findings
    assert (finding.effect, finding.where.sensor, finding.recording) == ("sensor_stuck", "frame_tip", None)
    assert finding.parameters["since"].value == 3.0
    assert "run_00: it stands still" in finding.statement
    assert "run_01: it stands still" in finding.statement
    later = replace(
        finding, statement="It stands still in run_02.", parameters={"since": Quantity(7.0, 0.1, "s")}
    )
    (both,) = with_intakes(replace(diagnosis(), findings=(later,)), intakes, ()).findings
    assert both.parameters["since"].value == 3.0
    assert both.statement.startswith("It stands still in run_02. run_00: it stands still")


def test_a_recording_of_which_nothing_is_left_is_refused_with_what_was_found() -> None:
    good = arm.small_arm(seconds=40.0, parts=("frame",))
    columns = {
        name: np.full_like(values, 2e4) if name.startswith("pressure_") else values
        for name, values in good.columns.items()
    }
    words = (
        r"no reading of the motion is left .* every pressure reads one and the same number while frame_tip"
    )
    with pytest.raises(InputError, match=words):
        check_recordings([replace(good, columns=columns)], [], arm.specimen())


MIRROR = arm.scaled("frame_", "_y_m", -1.0)


@pytest.mark.parametrize(("mirrored", "plain"), [(2, 0), (1, 2)])
def test_a_mirrored_laboratory_is_one_for_all_its_recordings(mirrored: int, plain: int) -> None:
    """One in which the arm hardly moves shows it hardly; it follows what more of the others show."""
    moving = [arm.small_arm(seed, parts=("frame",)) for seed in range(mirrored + plain)]
    runs = [MIRROR(one) for one in moving[:mirrored]] + moving[mirrored:]
    weak = arm.small_arm(9, parts=("frame",), flexibility=0.02)
    good = [*moving, weak]
    runs = [
        replace(one, name=f"run_{k}") for k, one in enumerate([*runs, MIRROR(weak) if not plain else weak])
    ]
    taken, _, _, notes = check_recordings(runs, (), arm.specimen())
    assert len([note for note in notes if "mirrored" in note]) == (mirrored if plain else mirrored + 1)
    for one, expected in zip(taken, good, strict=True):
        np.testing.assert_allclose(one.columns["frame_tip_y_m"], expected.columns["frame_tip_y_m"])
