"""What is refused before anything is computed, and what is handed over afterwards."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from softarm.analysis.diagnosis.intake import check_recordings
from softarm.analysis.diagnosis.run import DiagnosisRequest, improved_specimen, loaded, run, sessions_of
from softarm.analysis.diagnosis.workers import Inline
from softarm.common.shipped import fake_specimen
from softarm.estimator.diagnosis.admit import admit
from softarm.estimator.diagnosis.diagnose import DiagnosisOutcome
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.effects import EFFECTS, Spot, World
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.errors import InputError
from softarm.estimator.intake.result import NO_MISMATCH
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.estimator.specimen.physics import Place
from tests.estimator.intake import small_arm
from tests.estimator.simulation.straight_arm import world
from tests.service.diagnosis.made_diagnosis import diagnosis

SOPRA = load_specimen("sopra")


def _write(
    folder: Path, rows: list[str], columns: str = "t_s,pressure_0_pa,bend_tip_x_rad,bend_tip_y_rad"
) -> Path:
    folder.mkdir()
    (folder / "recording.csv").write_text("\n".join([columns, *rows]) + "\n")
    (folder / "recording.toml").write_text('specimen = "sopra"\nrate_hz = 10.0\n')
    return folder


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    rows = [f"{0.1 * k:.1f},{1e4 + 5e3 * np.sin(k):.0f},{0.2 * np.sin(k):.4f},0.01" for k in range(300)]
    return _write(tmp_path / "moving", rows)


def _refused(
    words: str, *recordings: Path, nominal: tuple[Path, ...] = (), specimen: Specimen = SOPRA
) -> None:
    with pytest.raises(InputError, match=words) as caught:
        run(DiagnosisRequest(recordings, nominal, specimen), Inline())
    assert "\n" not in str(caught.value)


def test_a_recording_given_twice_is_refused(moving: Path) -> None:
    _refused("moving: is given twice", moving, moving)
    _refused("moving: is given twice", moving, nominal=(moving,))


def test_another_specimen_is_refused(moving: Path) -> None:
    _refused(
        "was recorded on 'sopra', not on 'single_segment'", moving, specimen=load_specimen("single_segment")
    )


def test_a_recording_that_is_too_short_or_too_still_is_refused(tmp_path: Path) -> None:
    _refused("too short", _write(tmp_path / "short", [f"{0.1 * k},1000,0.1,0.1" for k in range(9)]))
    _refused("nothing moves", _write(tmp_path / "still", [f"{0.1 * k:.1f},1000,0.1,0.1" for k in range(99)]))


def test_a_recording_without_samples_is_set_aside_and_a_path_that_is_mistyped_is_not(
    moving: Path, tmp_path: Path
) -> None:
    empty = _write(tmp_path / "empty", [])
    _refused("holds no samples", empty)
    request = DiagnosisRequest((empty, moving), (), SOPRA)
    suspects, nominal, (note,) = loaded(request)
    assert ([one.name for one in suspects], nominal) == (["moving"], ())
    assert "empty/recording.csv: holds no samples; set aside" in note
    _refused("there is no such file", moving, tmp_path / "movign")


def test_an_effect_that_does_not_exist_is_named_with_the_nearest(moving: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'line_lag'"):
        run(DiagnosisRequest((moving,), (), SOPRA, effects=("line_lagg",)), Inline())


def test_a_clock_that_goes_back_is_refused(moving: Path, tmp_path: Path) -> None:
    back = tmp_path / "back"
    shutil.copytree(moving, back)
    lines = (back / "recording.csv").read_text().splitlines()
    (back / "recording.csv").write_text("\n".join([*lines[:200], *lines[150:]]) + "\n")
    _refused("time goes back", back)


def _outcome(gain: float, chamber: int) -> DiagnosisOutcome:
    place: World = world()
    placed = PlacedEffect(EFFECTS["chamber_gain"], Spot(place, Place(chamber=chamber)), np.array([gain]))
    return DiagnosisOutcome(replace(diagnosis(), recordings=("run",)), (placed,), ((0.01,),))


def test_what_was_found_is_handed_over_and_replaces_its_like() -> None:
    first = improved_specimen(SOPRA, _outcome(-0.2, 1))
    second = improved_specimen(first, _outcome(-0.1, 1))
    third = improved_specimen(second, _outcome(0.1, 2))
    gains = {entry.where.chamber: entry.parameters["gain"].value for entry in third.physics}
    assert gains == {1: -0.1, 2: 0.1}
    assert [entry.effect for entry in second.physics] == ["chamber_gain"]


def test_a_calibrated_specimen_stays_as_it_was_calibrated() -> None:
    known = load_specimen(fake_specimen())
    assert improved_specimen(known, _outcome(-0.2, 0)).calibration == known.calibration


def test_a_chamber_that_nobody_recorded_is_said_and_no_finding() -> None:
    recording = small_arm.small_arm(seconds=15.0, parts=("bend",))
    columns = {name: values for name, values in recording.columns.items() if "_3_pa" not in name}
    said: list[str] = []
    _, _, (intake,), notes = check_recordings(
        [replace(recording, columns=columns)], [], small_arm.specimen(), said.append
    )
    assert len(said) == 1
    assert "no pressure of chamber 3 was recorded, so it counts as vented (0 Pa)" in said[0]
    assert notes == tuple(said)
    assert all(one.kind in NO_MISMATCH for one in intake.mismatches)


def test_recordings_of_valves_alone_are_set_aside_where_others_hold_motion() -> None:
    arm = small_arm.small_arm(seconds=30.0, parts=("bend",))
    pressures = {name: values for name, values in arm.columns.items() if name.startswith("pressure_")}
    more = {**arm.columns, "pressure_9_pa": arm.columns["pressure_0_pa"]}
    valve, other = Recording("valve", arm.time, pressures), Recording("other", arm.time, more)
    model = cast("Model", SimpleNamespace(sections=("base", "intermediate", "tip")))
    admitted = admit([valve, arm, other], [], small_arm.specimen())
    sessions, notes = sessions_of(admitted, small_arm.specimen(), model)
    assert [session.name for session in sessions] == [arm.name]
    assert any(note.startswith("valve: holds no motion of the arm, only valves") for note in notes)
    assert any("the specimen has 6 chambers; set aside" in note for note in notes)
    assert [one.name for one in admitted.only({arm.name}).suspects] == [arm.name]
    with pytest.raises(InputError, match="valve: holds no motion"):
        sessions_of(admit([arm], [valve], small_arm.specimen()), small_arm.specimen(), model)
