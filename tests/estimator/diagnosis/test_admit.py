from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.admit import admit
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen

SOPRA = load_specimen("sopra")


def _recording(seconds: float = 30.0, bend: float = 0.3, **info) -> Recording:
    time = np.arange(0.0, seconds, 0.05)
    moved = bend * np.sin(time)
    columns = {"bend_tip_x_rad": moved, "bend_tip_y_rad": 0.5 * moved, "pressure_3_pa": 5e4 * moved**2}
    return Recording("run", time, columns, info)


def test_a_moving_recording_is_admitted() -> None:
    assert admit([_recording()], [], SOPRA).suspects[0].name == "run"


@pytest.mark.parametrize(
    ("recording", "words"),
    [(_recording(seconds=0.4), "too short"), (_recording(bend=0.0), "nothing moves")],
)
def test_what_cannot_decide_is_refused_with_what_is_missing(recording: Recording, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        admit([recording], [], SOPRA)
    assert "record" in str(caught.value)


VALVES = {f"pressure_{cmd}0_pa": 2e4 * (np.arange(300) % 100 > 50) for cmd in ("", "cmd_")}


@pytest.mark.parametrize(
    ("kept", "lacking"),
    [("pressure_cmd_0_pa", "record pressure_0_pa"), ("pressure_0_pa", "record pressure_cmd_0_pa")],
)
def test_valves_without_set_points_or_pressures_are_refused_with_the_columns_that_are_missing(
    kept: str, lacking: str
) -> None:
    recording = Recording("valves", 0.1 * np.arange(300), {kept: VALVES[kept]})
    with pytest.raises(InputError, match=f"alone, so nothing can be decided; {lacking} and its like as well"):
        admit([recording], [], SOPRA)


@pytest.mark.parametrize(
    ("samples", "words"),
    [(300, "nothing moves"), (1, "1 sample in 0 s is too short"), (5, "5 samples in 0.4 s")],
)
def test_a_beam_is_never_asked_for_pressures(samples: int, words: str) -> None:
    rest = {f"marker_tip1_{axis}_m": np.zeros(samples) for axis in "xyz"}
    with pytest.raises(InputError, match=words) as caught:
        admit([Recording("rest", 0.1 * np.arange(samples), rest)], [], load_specimen("beam"))
    assert "record at least 20 s in which the arm moves and comes to rest" in str(caught.value)
    assert "pressure" not in str(caught.value)


def _named(recording: Recording, name: str) -> Recording:
    return replace(recording, name=name)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (_recording(seconds=0.4), "8 samples in 0.35 s are too short"),
        (_recording(specimen="single_segment"), "was recorded on 'single_segment', not on 'sopra'"),
        (_recording(bend=np.nan), "no reading of the motion is left"),
    ],
)
@pytest.mark.parametrize("nominal", [True, False])
def test_one_of_several_that_cannot_decide_is_set_aside(bad: Recording, words: str, *, nominal: bool) -> None:
    good, bad = _named(_recording(), "good"), _named(bad, "bad")
    groups = ([good], [good, bad]) if nominal else ([good, bad], [good])
    said: list[str] = []
    admitted = admit(*groups, SOPRA, said.append)
    assert admitted.suspects == admitted.nominal == (good,)
    (note,) = admitted.notes
    assert said == [note]
    assert note.startswith("bad")
    assert words in note.partition("; set aside, ")[0]
    with pytest.raises(InputError, match=words):
        admit([good] if nominal else [bad], [bad] if nominal else [good], SOPRA)


def test_a_recording_without_chambers_that_others_hold_is_set_aside() -> None:
    few = _recording()
    levels = {f"pressure_{k}_pa": few.columns["pressure_3_pa"] for k in range(6)}
    whole = Recording("whole", few.time, few.columns | levels)
    admitted = admit([few, whole], [], SOPRA)
    assert admitted.suspects == (whole,)
    assert (
        "run: lacks the pressures of chambers 0, 1, 2, 4, 5, which other recordings hold" in admitted.notes[0]
    )
    valves = Recording("valves", few.time, {"pressure_3_pa": few.columns["pressure_3_pa"]})
    assert admit([valves, whole], [], SOPRA).suspects == (valves, whole)


def test_a_recording_of_another_specimen_is_refused() -> None:
    other = Recording(
        "run",
        np.arange(0.0, 30.0, 0.1),
        {f"pressure_{k}_pa": np.zeros(300) for k in range(9)},
        {"specimen": "other"},
    )
    with pytest.raises(InputError, match="was recorded on 'other'"):
        admit([other], [], SOPRA)


def test_gaps_and_jumps_of_the_clock_are_told() -> None:
    plain = _recording()
    time = plain.time + np.where(plain.time > 10.0, 7.0, 0.0)
    notes = admit([Recording("run", time, plain.columns)], [], SOPRA).notes
    assert any("the clock jumps by 7.05 s at 10.0 s" in note for note in notes)
    lost = plain.window((plain.time < 10.0) | (plain.time > 11.5))
    assert any("a gap of 1.6" in note for note in admit([lost], [], SOPRA).notes)


def test_a_sensor_that_is_slower_than_others_has_lost_nothing() -> None:
    """Streams of an MCAP file have their own times: between them cells are empty."""
    plain = _recording()
    slow = {
        name: np.where(np.arange(len(plain.time)) % 3 == 0, v, np.nan) for name, v in plain.columns.items()
    }
    slow["pressure_3_pa"] = plain.columns["pressure_3_pa"]
    assert admit([Recording("run", plain.time, slow)], [], SOPRA).notes == ()
    slow["bend_tip_x_rad"] = np.where(
        np.arange(len(plain.time)) % 7 < 4, plain.columns["bend_tip_x_rad"], np.nan
    )
    (note,) = admit([Recording("run", plain.time, slow)], [], SOPRA).notes
    assert note == "run: 43% of the readings of bend_tip, axis x, are lost."


def test_motion_without_pressures_is_refused() -> None:
    plain = _recording()
    still = {name: values for name, values in plain.columns.items() if name.startswith("bend")}
    with pytest.raises(InputError, match="holds no pressures"):
        admit([Recording("run", plain.time, still)], [], SOPRA)


def test_a_shipped_specimen_is_not_taken_for_another() -> None:
    time = np.arange(0.0, 5.0, 0.01)
    markers = {f"marker_tip1_{axis}_m": 0.1 * np.sin(time) for axis in "xyz"}
    beam = Recording("swing", time, {**markers, "pressure_0_pa": time}, {"specimen": "beam"})
    with pytest.raises(InputError, match="recorded on 'beam'"):
        admit([beam], [], load_specimen("single_segment"))


def test_a_gap_of_one_sensor_is_named() -> None:
    plain = _recording()
    bends = {f"bend_tip_{axis}_rad": plain.columns[f"bend_tip_{axis}_rad"] for axis in "xy"}
    gap = (plain.time > 10.02) & (plain.time < 11.98)
    lost = {name: np.where(gap, np.nan, values) for name, values in bends.items()}
    (note,) = admit([Recording("run", plain.time, plain.columns | lost)], [], SOPRA).notes
    assert note == "run: bend_tip has a gap of 2.00 s."


def test_a_sensor_that_never_reads_is_lost_and_alone_no_motion() -> None:
    plain = _recording()
    nothing = {f"bend_intermediate_{axis}_rad": np.full(len(plain.time), np.nan) for axis in "xy"}
    (note,) = admit([Recording("run", plain.time, plain.columns | nothing)], [], SOPRA).notes
    assert note == "run: 100% of the readings of bend_intermediate are lost."
    pressures = {"pressure_3_pa": plain.columns["pressure_3_pa"]}
    with pytest.raises(InputError, match="no reading of the motion is left"):
        admit([Recording("run", plain.time, pressures | nothing)], [], SOPRA)


def test_mended_recordings_keep_their_part_and_why() -> None:
    admitted = admit([_recording()], [_recording(bend=0.2)], SOPRA)
    mended = admitted.mended(lambda r: r.window(r.time < 10.0), ["cut"])
    assert [(r.time[-1] < 10.0, nominal) for r, nominal in mended.all] == [(True, True), (True, False)]
    assert mended.notes == (*admitted.notes, "cut")


def test_a_copy_of_a_specimen_under_a_name_of_its_own_is_admitted() -> None:
    assert admit([_recording(specimen="my_arm")], [], SOPRA).suspects
