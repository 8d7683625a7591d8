"""Every fault that an intake looks for, planted singly and in twos into a good recording."""

import re
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest

from softarm.estimator.calibration import arrange
from softarm.estimator.errors import InputError
from softarm.estimator.intake import check_recording
from softarm.estimator.intake.labels import correct_labels
from softarm.estimator.intake.lost import correct_lost
from softarm.estimator.intake.signs import correct_signs
from softarm.estimator.intake.units import correct_units
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen
from tests.estimator.intake import small_arm as arm

SPECIMEN = arm.specimen()
CORRECTED = {
    "kilopascals": (arm.scaled("pressure_", "_pa", 1e-3), "in kilopascals"),
    "bars": (arm.scaled("pressure_", "_pa", 1e-5), "in bars"),
    "measured kilopascals": (
        arm.both(arm.scaled("pressure_", "_pa", 1e-3), arm.scaled("pressure_cmd_", "_pa", 1e3)),
        "the measured pressures reach .* in kilopascals",
    ),
    "one chamber in kilopascals": (
        arm.both(arm.scaled("pressure_1", "_pa", 1e-3), arm.scaled("pressure_cmd_1", "_pa", 1e-3)),
        "pressure_1_pa reaches .* less than other chambers; taken for kilopascals",
    ),
    "one measured pressure in bars": (
        arm.scaled("pressure_4", "_pa", 1e-5),
        "pressure_4_pa reaches .* less than other chambers; taken for bars",
    ),
    "absolute": (
        arm.both(
            arm.scaled("pressure_", "_pa", 1.0, 101325.0), arm.scaled("pressure_cmd_", "_pa", 1.0, -101325.0)
        ),
        "absolute",
    ),
    "all absolute": (arm.scaled("pressure_", "_pa", 1.0, 101325.0), "absolute"),
    "one absolute": (
        arm.scaled("pressure_2", "_pa", 1.0, 98e3),
        "pressure_2_pa never comes below 9[78].* kPa, .* it is absolute; 9[78].* Pa, its reading at rest",
    ),
    "milliseconds": (
        arm.both(arm.in_milliseconds, arm.stated(rate_hz=arm.RATE)),
        "it is in milliseconds",
    ),
    "zeros": (arm.zeros_where_lost, "marker_tip0 40 zeros"),
    "placeholders": (
        arm.placeholders(-9999.0, ("frame_tip", "marker_tip0", "bend_tip")),
        "one number on all axes .* frame_tip 160 times -9999, marker_tip0 160 times",
    ),
    "small placeholders": (arm.placeholders(-1.0, ("frame_tip",), ("_m",)), "frame_tip 160 times -1"),
    "far readings": (arm.placeholders(-9999.0, ("frame_tip_x",)), "frame_tip 160 readings beyond 50 m"),
    "degrees": (arm.scaled("bend_", "_rad", 57.29578), "in degrees"),
    "millimetres": (arm.scaled("frame_", "_m", 1e3), "in millimetres"),
    "markers in millimetres": (arm.scaled("marker_", "_m", 1e3), "in millimetres"),
    "one marker in millimetres": (
        arm.scaled("marker_tip0", "_m", 1e3),
        "marker_tip0 lies 2.* m from the middle of the others, .*: it is in millimetres",
    ),
    "two markers in millimetres": (
        arm.both(arm.scaled("marker_tip0", "_m", 1e3), arm.scaled("marker_tip2", "_m", 1e3)),
        "marker_tip2 lies 2.* m from the middle of the others, .*: it is in millimetres",
    ),
    "one frame in millimetres": (
        arm.scaled("frame_tip", "_m", 1e3),
        "frame_tip lies 2.* m from the middle of the others, .*: it is in millimetres",
    ),
    "late": (arm.shifted(("bend", "frame", "marker"), 2.0), "2.* s behind the pressures"),
    "early": (arm.shifted(("bend", "frame", "marker"), -1.5), "1.* s ahead of the pressures"),
    "one late": (arm.shifted(("bend_tip",), 2.0), "bend_tip is 2.* s behind"),
    "markers": (arm.exchanged("marker_tip0", "marker_tip1"), "tip0 and tip1 are exchanged"),
    "markers of two bodies": (arm.exchanged("marker_tip0", "marker_base1"), "base1 and tip0 are exchanged"),
    "mirrored markers": (
        arm.scaled("marker_", "_y_m", -1.0),
        "the y axis of the markers, and not of the frames, is mirrored: only so do the sections lie",
    ),
    "frames": (arm.exchanged("frame_intermediate", "frame_tip"), "intermediate and tip are exchanged"),
    "bends": (arm.exchanged("bend_intermediate", "bend_tip"), "bends of intermediate and tip are exchanged"),
    "mirrored frames": (
        arm.scaled("frame_", "_y_m", -1.0),
        "y axis of the laboratory's positions is mirrored, and that of the markers is not",
    ),
    "mirrored positions": (
        arm.scaled("", "_y_m", -1.0),
        "y axis of the laboratory's positions is mirrored: positions follow",
    ),
    "mirrored heights": (
        arm.scaled("", "_z_m", -1.0),
        "z axis of the laboratory's positions is mirrored: positions follow",
    ),
    **{
        f"left-handed {letter}": (
            arm.left_handed(axis),
            f"the {letter} axis of the laboratory( is mirrored)?, in positions and orientations",
        )
        for axis, letter in enumerate("xyz")
    },
}
REFUSED = {
    "no base, turned": (
        arm.both(arm.rotated((0.0, 0.0, 1.2)), arm.without_base),
        "rotated by 6[789] degrees",
    ),
    "no base, tilted": (arm.both(arm.rotated((0.9, 0.0, 0.0)), arm.without_base), "from its rest position"),
    "one marker in centimetres": (
        arm.scaled("marker_tip0", "_m", 100.0),
        "marker_tip0 lies 27.* m from .* millimetres or centimetres",
    ),
    "no base, mirrored": (arm.both(arm.scaled("", "_y_m", -1.0), arm.without_base), "mirrored frame"),
    "frames, left-handed x": (arm.both(arm.only("frame"), arm.left_handed(0)), "as in a mirrored frame"),
    "frames, left-handed y": (arm.both(arm.only("frame"), arm.left_handed(1)), "as in a mirrored frame"),
    "frames, upside down": (
        arm.both(
            arm.only("frame"),
            arm.both(
                arm.body_turned("base", (np.pi, 0.0, 0.0)),
                arm.both(
                    arm.body_turned("intermediate", (np.pi, 0.0, 0.0)),
                    arm.body_turned("tip", (np.pi, 0.0, 0.0)),
                ),
            ),
        ),
        "the z axes of all bodies point from the tip to the base, or the laboratory is left-handed",
    ),
    "tilted body": (
        arm.both(arm.only("frame"), arm.body_turned("tip", (0.0, 1.05, 0.0))),
        "positions and orientations of base, intermediate, tip contradict each other by [45]. mm",
    ),
    "frames, base turned": (
        arm.both(arm.only("frame"), arm.body_turned("base", (0.0, 0.0, 1.2))),
        "rotated by -6[789] degrees about its axis, as the base registers it",
    ),
    "base unread, turned": (
        arm.both(arm.rotated((0.0, 0.0, 1.2)), arm.base_unread),
        "rotated by 6[789] degrees",
    ),
    "base unread, tilted": (
        arm.both(arm.rotated((0.9, 0.0, 0.0)), arm.base_unread),
        "from its rest position",
    ),
    "base of zeros, turned": (
        arm.both(arm.only("frame"), arm.both(arm.rotated((0.0, 0.0, 1.2)), arm.base_of_zeros)),
        "rotated by 6[789] degrees .* nothing of the base was read",
    ),
    "suction": (arm.scaled("pressure_", "_pa", -1.0), "below that of the air; reverse its sign"),
    "three of six chambers": (arm.three_chambers, "has chambers 0, 1, 2, the specimen has 6"),
    "time without a unit": (arm.in_milliseconds, "t_s rises by 50 .* set rate_hz"),
}
EVENTS = {
    "hand": (arm.touched(40.0), 40.0, 43.0),
    "violent start": (arm.thrown(), 0.0, 2.0),
}
KINDS = (
    ("absolute",),
    ("markers", "frames", "bends"),
    ("mirrored frames",),
    ("late", "one late"),
    ("kilopascals", "one chamber in kilopascals", "degrees", "millimetres"),
)
"""Faults of one kind each, in the order in which two of them are planted: what is scaled comes last."""
PAIRS = [
    *(pair for one, other in combinations(KINDS, 2) for pair in product(one, other)),
    ("zeros", "markers"),
    ("millimetres", "placeholders"),
    ("placeholders", "degrees"),
    ("zeros", "markers in millimetres"),
    ("milliseconds", "kilopascals"),
    ("all absolute", "bars"),
    ("one measured pressure in bars", "late"),
]


@pytest.fixture(scope="module")
def good() -> Recording:
    return arm.small_arm()


@pytest.fixture
def without_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the search for events: it comes last, corrects nothing and takes two thirds of the time."""
    monkeypatch.setattr("softarm.estimator.intake.intake.find_events", lambda *_: ())


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_found_in_a_good_recording(seed: int) -> None:
    intake = check_recording(arm.small_arm(seed), SPECIMEN)
    assert intake.sentences == ()
    assert intake.refusals == ()


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("name", CORRECTED)
def test_a_fault_is_named_and_corrected(good: Recording, name: str) -> None:
    fault, words = CORRECTED[name]
    intake = check_recording(fault(good), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, words)
    _require_alike(intake.recording, good)
    assert sum("mirrored" in sentence for sentence in intake.sentences) == (
        "mirror" in name or "handed" in name
    )


@pytest.mark.usefixtures("without_events")
def test_quaternions_in_another_order_are_corrected_and_never_taken_for_exchanged_frames() -> None:
    frames = arm.small_arm(parts=("frame",), flexibility=1.8)
    intake = check_recording(arm.scalar_last(frames), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, "the quaternions are in the order x, y, z, w")
    for name, values in frames.columns.items():
        np.testing.assert_array_equal(intake.recording.columns[name], values)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("parts", [("marker",), ("frame", "marker")])
def test_exchanged_markers_of_a_mirrored_laboratory_are_told_from_others_by_frames_or_pressures(
    seed: int, parts: tuple[str, ...]
) -> None:
    """Of the markers alone, two others of the base that are exchanged explain as much, with fewer faults."""
    good = arm.small_arm(seed, parts=parts)
    mirrored = arm.both(arm.exchanged("marker_tip0", "marker_tip1"), arm.scaled("marker_", "_y_m", -1.0))
    intake = check_recording(mirrored(good), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, "markers tip0 and tip1 are exchanged and .* is mirrored")
    _require_alike(intake.recording, good)


def test_exchanged_markers_are_refused_where_nothing_tells_them_from_a_mirrored_laboratory() -> None:
    markers = arm.small_arm(parts=("marker",))
    columns = {n: np.full_like(v, 3e4) for n, v in markers.columns.items() if n.startswith("pressure")}
    recording = replace(markers, columns={**markers.columns, **columns})
    _, (found,) = correct_labels(arm.exchanged("marker_tip0", "marker_tip1")(recording), SPECIMEN)
    assert not found.corrected
    assert "tip0 and tip1 are exchanged, or markers base0 and base1 are exchanged and one axis" in found.what


@pytest.mark.usefixtures("without_events")
def test_frames_of_a_laboratory_with_a_left_handed_height_are_corrected_by_the_pressures(
    good: Recording,
) -> None:
    frames = arm.only("frame")(good)
    intake = check_recording(arm.left_handed(2)(frames), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, "z axis of the laboratory is mirrored, in positions and orientations")
    _require_alike(intake.recording, frames)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("names", PAIRS, ids=" and ".join)
def test_two_faults_are_named_and_corrected(good: Recording, names: tuple[str, str]) -> None:
    (first, words), (second, more) = (CORRECTED[name] for name in names)
    intake = check_recording(arm.both(first, second)(good), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, words)
    _require(intake.sentences, more)
    _require_alike(intake.recording, good)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("name", ["", *(kind[-1] for kind in KINDS if kind != ("mirrored frames",))])
def test_a_laboratory_that_is_turned_hides_no_other_fault(good: Recording, name: str) -> None:
    turned = arm.rotated((0.2, -0.1, 1.2))(good)
    fault, words = CORRECTED[name] if name else (lambda one: one, "")
    intake = check_recording(fault(turned), SPECIMEN)
    assert not intake.refusals
    assert bool(intake.sentences) == bool(name)
    if name:
        _require(intake.sentences, words)
    _require_alike(intake.recording, turned)


@pytest.mark.parametrize("unit", ["", *(kind[0] for kind in KINDS)])
@pytest.mark.parametrize("name", EVENTS)
def test_an_event_is_found_and_left_out_of_fits(good: Recording, name: str, unit: str) -> None:
    fault, begin, end = EVENTS[name]
    recording = fault(good)
    if unit:
        recording = CORRECTED[unit][0](recording)
        begin, end = (begin + 2.0, min(end + 2.0, 79.5)) if unit == "late" else (begin, end)
    intake = check_recording(recording, SPECIMEN)
    assert not intake.refusals
    inside = (good.time > begin + 0.5) & (good.time < end - 0.5)
    seen = np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][inside])
    assert seen.mean() < 0.25
    kept = np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][~inside])
    assert kept.mean() > 0.6
    assert all(event.size_rad > np.radians(2.0) for event in intake.events)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("asked", [True, False])
def test_an_idle_chamber_that_the_bent_arm_squeezes_keeps_its_unit(good: Recording, *, asked: bool) -> None:
    bend = good.columns["bend_intermediate_x_rad"]
    squeezed = 300.0 * (bend - np.nanmin(bend))
    columns = {**good.columns, "pressure_2_pa": squeezed, "pressure_cmd_2_pa": np.zeros(len(squeezed))}
    if not asked:
        columns = {name: values for name, values in columns.items() if "cmd" not in name}
    corrected, found = correct_units(Recording("run", good.time, columns, good.info), SPECIMEN)
    assert not found
    np.testing.assert_array_equal(corrected.columns["pressure_2_pa"], squeezed)


@pytest.mark.parametrize("name", ["kilopascals", "one chamber in kilopascals"])
def test_pressures_that_are_stated_to_be_in_pascals_are_left_alone(good: Recording, name: str) -> None:
    stated = arm.stated(pressure_unit="Pa")(CORRECTED[name][0](good))
    corrected, found = correct_units(stated, SPECIMEN)
    assert not found
    np.testing.assert_array_equal(corrected.columns["pressure_1_pa"], stated.columns["pressure_1_pa"])


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("name", ["degrees", "absolute", "all absolute"])
def test_a_stated_unit_of_pressures_hides_no_other_fault(good: Recording, name: str) -> None:
    fault, words = CORRECTED[name]
    intake = check_recording(arm.both(fault, arm.stated(pressure_unit="Pa"))(good), SPECIMEN)
    assert not intake.refusals
    _require(intake.sentences, words)
    _require_alike(intake.recording, good)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize(("unit", "pascals"), [("kPa", 1e3), ("psi", 6894.757), ("mbar", 1e2), ("hpa", 1e2)])
def test_pressures_are_converted_from_the_stated_unit(good: Recording, unit: str, pascals: float) -> None:
    fault = arm.both(arm.scaled("pressure_", "_pa", 1.0 / pascals), arm.stated(pressure_unit=unit))
    intake = check_recording(fault(good), SPECIMEN)
    assert not intake.refusals
    _require_alike(intake.recording, good)
    assert not check_recording(
        intake.recording, SPECIMEN
    ).sentences  # what was converted is not converted again


@pytest.mark.parametrize(
    ("unit", "words"),
    [("torr", "pressure_unit is 'torr' .* none of Pa, kPa"), ("kPa", "would reach .* times the limit of 65")],
)
def test_a_stated_unit_that_cannot_be_is_refused(good: Recording, unit: str, words: str) -> None:
    (refusal,) = check_recording(arm.stated(pressure_unit=unit)(good), SPECIMEN).refusals
    assert re.search(words, str(refusal))


@pytest.mark.parametrize("kind", ["frame_", "marker_", ""])
def test_a_marker_that_the_specimen_does_not_describe_shares_the_unit_of_the_others(
    good: Recording, kind: str
) -> None:
    hook = {f"marker_hook_{axis}_m": good.columns[f"frame_tip_{axis}_m"] + 0.02 for axis in "xyz"}
    columns = {**good.columns, **hook}
    if kind != "marker_":
        columns = {
            name: v for name, v in columns.items() if not name.startswith(("marker_base", "marker_tip"))
        }
    if kind == "marker_":
        columns = {name: values for name, values in columns.items() if not name.startswith("frame_")}
    tied = replace(good, columns=columns)
    fault = arm.scaled("", "_m", 1e3) if kind else arm.scaled("marker_hook", "_m", 1e3)
    corrected, found = correct_units(fault(tied), SPECIMEN)
    if kind:
        assert "marker_hook lies " in found[-1].what
        assert "it is in millimetres as the others" in found[-1].what
        np.testing.assert_allclose(corrected.marker("hook"), tied.marker("hook"))
        left_alone, _ = correct_units(
            arm.scaled(kind, "_m", 1e3)(tied) if kind == "frame_" else tied, SPECIMEN
        )
        np.testing.assert_allclose(left_alone.marker("hook"), tied.marker("hook"))
    else:
        assert not found[-1].corrected
        assert re.search("marker_hook lies 2.* m from the arm", found[-1].what)


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("stays_filled", [True, False])
def test_one_absolute_pressure_is_corrected_where_its_chamber_rests(
    good: Recording, *, stays_filled: bool
) -> None:
    measured = {name: values for name, values in good.columns.items() if "cmd" not in name}
    filled = np.maximum(measured["pressure_2_pa"], 8e3 + 4e3 * np.sin(good.time) if stays_filled else 0.0)
    recording = replace(good, columns={**measured, "pressure_2_pa": 98e3 + filled})
    intake = check_recording(recording, SPECIMEN)
    assert bool(intake.refusals) == stays_filled
    sentence = str(intake.refusals[0]) if stays_filled else intake.sentences[0]
    assert re.search("pressure_2_pa never comes below .* it is absolute", sentence)
    assert "raise" not in sentence
    if not stays_filled:
        np.testing.assert_allclose(intake.recording.columns["pressure_2_pa"], filled, atol=1e3)


@pytest.mark.parametrize("chambers", [True, False])
def test_bends_beyond_a_whole_turn_are_in_degrees(good: Recording, *, chambers: bool) -> None:
    slight = arm.scaled("bend_", "_rad", 0.2 * 57.29578)(good)
    if not chambers:
        columns = {name: values for name, values in slight.columns.items() if name.startswith("bend_")}
        slight = replace(slight, columns=columns)
    corrected, (found,) = correct_units(slight, SPECIMEN)
    assert "are in degrees" in found.what
    for name in ("bend_tip_x_rad", "bend_intermediate_y_rad"):
        np.testing.assert_allclose(corrected.columns[name], 0.2 * good.columns[name])


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("shift", [0.0, 2.0])
@pytest.mark.parametrize("section", ["intermediate", "tip"])
def test_the_unit_of_a_bend_is_its_own(good: Recording, section: str, shift: float) -> None:
    good = arm.only("bend")(good)
    mixed = arm.scaled(f"bend_{section}", "_rad", 57.29578)(arm.shifted(("bend",), shift)(good))
    intake = check_recording(mixed, SPECIMEN)
    _require(intake.sentences, f"the bends of {section} were converted for this run")
    _require_alike(intake.recording, good)


def test_a_bend_in_degrees_that_no_chamber_drives_is_in_the_unit_of_the_other(good: Recording) -> None:
    vented = arm.scaled("pressure_", "_pa", 1.0)
    for column in (f"pressure_{cmd}{k}_pa" for cmd in ("", "cmd_") for k in (3, 4, 5)):
        vented = arm.both(vented, arm.scaled(column, "", 0.0))
    degrees = arm.both(arm.scaled("bend_", "_rad", 57.29578), arm.scaled("bend_tip", "", 0.01))
    corrected, (found,) = correct_units(arm.both(vented, degrees)(good), SPECIMEN)
    assert "the bends reach" in found.what
    np.testing.assert_allclose(corrected.columns["bend_tip_x_rad"], 0.01 * good.columns["bend_tip_x_rad"])


def test_a_bend_beside_degrees_that_may_be_in_either_unit_is_refused(good: Recording) -> None:
    mixed = arm.both(arm.scaled("bend_tip", "_rad", 57.29578), arm.scaled("bend_intermediate", "_rad", 5.0))
    (refusal,) = check_recording(mixed(good), SPECIMEN).refusals
    assert "in degrees or in radians; give all bends in radians" in str(refusal)


def test_a_chamber_that_is_commanded_to_open_hardly_at_all_is_no_other_unit(good: Recording) -> None:
    slow = 1000.0 * (1.0 - np.cos(0.2 * good.time))
    columns = {"pressure_cmd_3_pa": slow, "pressure_3_pa": 100.0 * np.round(0.3 * slow / 100.0)}
    recording = replace(good, columns={**good.columns, **columns})
    corrected, found = correct_units(recording, SPECIMEN)
    assert not found
    np.testing.assert_array_equal(corrected.columns["pressure_3_pa"], columns["pressure_3_pa"])


def test_a_hardly_opened_chamber_whose_command_resembles_the_bends_is_no_other_unit(good: Recording) -> None:
    bends = np.column_stack([good.bend("tip"), good.bend("intermediate")])
    others = np.column_stack([np.ones(len(good.time)), *(good.pressure(k)[0] for k in (0, 1, 2, 4, 5))])
    left = bends - others @ np.linalg.lstsq(others, bends, rcond=None)[0]
    like_bends = np.linalg.svd(left, full_matrices=False)[0][:, 0]
    asked = 657.0 * (like_bends - like_bends.min()) / np.ptp(like_bends)
    reported = 100.0 * np.round(0.3 * asked / 100.0) * (np.sin(good.time) > 0.0)  # in steps, now and then
    columns = {"pressure_cmd_3_pa": asked, "pressure_3_pa": reported}
    recording = replace(good, columns={**good.columns, **columns})
    corrected, found = correct_units(recording, SPECIMEN)
    assert not found
    np.testing.assert_array_equal(corrected.columns["pressure_cmd_3_pa"], asked)


@pytest.mark.parametrize("touched", [False, True])
def test_a_first_loading_that_is_stiffer_is_a_law_and_a_touch_on_later_ones_is_none(*, touched: bool) -> None:
    time = np.arange(0.0, 60.0, 0.05)
    level = 1.0 - np.abs((time / 10.0) % 2.0 - 1.0)
    softened = 1.0 - np.exp(-(np.maximum.accumulate(level) - level) / 0.05)
    bend = 0.6 * level * (1.0 + 0.3 * softened)
    if touched:
        bend += 0.25 * np.clip(np.minimum(time - 33.0, 36.0 - time) / 0.8, 0.0, 1.0)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, (2, len(time)))
    bends = {"bend_tip_x_rad": bend + noise[0], "bend_tip_y_rad": 0.3 * bend + noise[1]}
    columns = {"pressure_0_pa": 45e3 * level, **bends}
    events = check_recording(Recording("run", time, columns, {"specimen": "sopra"}), SPECIMEN).events
    assert [event.interval[0] < 34.0 < event.interval[1] for event in events] == [True] * touched


def test_a_body_that_is_found_elsewhere_is_an_event(good: Recording) -> None:
    intake = check_recording(arm.lost_and_found(at=50.5)(good), SPECIMEN)
    assert any("bend_tip" in event.channels for event in intake.events)
    after = np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][good.time > 52.0])
    before = np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][good.time < 49.0])
    assert after.mean() < 0.05
    assert before.mean() > 0.9


@pytest.mark.parametrize("name", REFUSED)
def test_a_fault_that_cannot_be_corrected_is_refused_with_a_cure(good: Recording, name: str) -> None:
    fault, words = REFUSED[name]
    (refusal,) = check_recording(fault(good), SPECIMEN).refusals
    assert re.search(words, str(refusal))
    assert refusal.cure


def test_a_base_that_was_never_read_registers_nothing(good: Recording) -> None:
    unread = arm.base_unread(arm.only("frame")(good))
    with pytest.raises(InputError, match="frame_base: holds no reading, so that nothing registers"):
        arrange(unread, SPECIMEN, ("base", "intermediate", "tip"))


def test_a_recording_without_the_base_may_be_in_its_frame(good: Recording) -> None:
    assert not check_recording(arm.without_base(good), SPECIMEN).sentences


@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_spikes_count_as_lost_and_motion_does_not(good: Recording, rate: float) -> None:
    time = np.arange(0.0, 10.0, 1.0 / rate)
    swing = 0.35 * np.sin(2.0 * np.pi * 2.3 * time) * np.exp(-time)
    bad = swing.copy()
    bad[[100, 300, 301]] += [1.0, -1.0, -1.0]
    columns = {"bend_tip_x_rad": bad, "bend_tip_y_rad": swing, "pressure_0_pa": 3e4 + 1e3 * swing}
    columns["pressure_0_pa"][200] = 655350.0
    corrected, (found,) = correct_lost(Recording("run", time, columns), SPECIMEN)
    assert "bend_tip 3 spikes, pressure_0_pa 1 spikes" in found.what
    assert np.flatnonzero(np.isnan(corrected.columns["bend_tip_x_rad"])).tolist() == [100, 300, 301]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_sign_of_a_gauge_that_pushes_is_turned(good: Recording, sign: float) -> None:
    pull = 0.4 * np.clip(np.sin(good.time / 5.0), 0.0, 1.0)
    columns = {**good.columns, "gauge_cord_n": sign * pull}
    tied = Recording("run", good.time, columns, {**good.info, "gauge_section": "tip"})
    corrected, found = correct_signs(tied, SPECIMEN)
    assert len(found) == (sign < 0.0)
    np.testing.assert_array_equal(corrected.gauge("cord"), pull)


def test_violent_motion_does_not_make_markers_wrong(good: Recording) -> None:
    columns = dict(good.columns)
    rng = np.random.default_rng(3)
    rough = good.time < 16.0  # no rigid body: reflections are taken for each other
    for name in columns:
        if name.startswith("marker_tip"):
            columns[name] = np.where(rough, columns[name] + rng.normal(0.0, 0.05, len(rough)), columns[name])
    assert not correct_labels(Recording("run", good.time, columns, good.info), SPECIMEN)[1]


def test_another_specimen_is_refused_with_what_differs(good: Recording) -> None:
    (refusal,) = check_recording(good, load_specimen("single_segment")).refusals
    assert "recorded on 'sopra', not on 'single_segment'" in str(refusal)
    assert "chambers 0, 1, 2, 3, 4, 5, the specimen has 4" in str(refusal)


def test_a_specimen_without_chambers_has_none() -> None:
    columns = {"pressure_0_pa": np.linspace(0.0, 1e4, 50)}
    columns |= {f"marker_tip1_{axis}_m": np.zeros(50) for axis in "xyz"}
    (refusal,) = check_recording(
        Recording("run", 0.1 * np.arange(50), columns), load_specimen("beam")
    ).refusals
    assert "it has chamber 0, the specimen has none" in str(refusal)


def test_pressures_above_the_limit_are_left_out_of_fits(good: Recording) -> None:
    chambers = tuple(c.model_copy(update={"pressure_limit_pa": 40e3}) for c in SPECIMEN.chambers)
    intake_specimen = SPECIMEN.model_copy(update={"chambers": chambers})
    intake = check_recording(good, intake_specimen)
    above = np.any([good.columns[f"pressure_{k}_pa"] > 44e3 for k in range(6)], axis=0)
    assert not intake.refusals
    assert "over its limit of 40" in intake.sentences[0]
    for seen in (intake.for_fits, intake.for_estimates):
        assert not np.isfinite(seen.columns["bend_tip_x_rad"][above]).any()
    assert arrange(intake.for_estimates, intake_specimen).pressures.max() < 44e3


@pytest.mark.parametrize("moved", [True, False])
def test_seconds_without_pressures_are_named_and_no_event(good: Recording, *, moved: bool) -> None:
    lost = (good.time > 30.0) & (good.time < 42.0)
    measured = tuple(f"pressure_{k}_pa" for k in range(6))
    columns = {n: np.where(lost, np.nan, v) if n in measured else v for n, v in good.columns.items()}
    if not moved:
        columns = {n: np.where(lost, np.nan, v) if n.startswith("bend") else v for n, v in columns.items()}
        columns = {n: v for n, v in columns.items() if not n.startswith(("frame", "marker"))}
    intake = check_recording(replace(good, columns=columns), SPECIMEN)
    assert not intake.events
    assert not intake.refusals
    words = (
        "run: no pressure of chambers 0, 1, 2, 3, 4, 5 was read from 30.0 to 42.0 s; left out of every fit"
    )
    assert [words in sentence for sentence in intake.sentences] == [True] * moved
    seen = np.isfinite(intake.for_fits.columns["bend_tip_x_rad"])
    assert not seen[lost].any()
    assert seen[~lost].mean() > 0.95


@pytest.mark.usefixtures("without_events")
@pytest.mark.parametrize("lost", [(), (3,), (1, 4)])
@pytest.mark.parametrize("empty", [True, False])
def test_a_chamber_that_nobody_recorded_counts_as_vented_and_is_named(
    good: Recording, lost: tuple[int, ...], *, empty: bool
) -> None:
    columns = {
        name: np.full_like(values, np.nan) if name.endswith(tuple(f"_{k}_pa" for k in lost)) else values
        for name, values in good.columns.items()
    }
    if not empty:
        columns = {name: values for name, values in columns.items() if not np.isnan(values).all()}
    intake = check_recording(replace(good, columns=columns), SPECIMEN)
    words = {
        (): (),
        (3,): (
            "run: no pressure of chamber 3 was recorded, so it counts as vented (0 Pa); if it was not, add "
            "pressure_3_pa [Pa, gauge].",
        ),
        (1, 4): (
            "run: no pressure of chambers 1, 4 was recorded, so they count as vented (0 Pa); if they were "
            "not, add pressure_1_pa, pressure_4_pa [Pa, gauge].",
        ),
    }
    assert intake.sentences == words[lost]
    assert not intake.refusals
    arranged = arrange(intake.recording, SPECIMEN, ("base", "intermediate", "tip")).pressures
    assert not arranged[:, list(lost)].any()


@pytest.mark.parametrize("rows", [1, 2, 30])
def test_short_recordings_end_without_an_error(good: Recording, rows: int) -> None:
    assert check_recording(good.window(np.arange(len(good.time)) < rows), SPECIMEN).events == ()


def test_sensors_that_were_never_seen_end_without_an_error(good: Recording) -> None:
    columns = {
        n: np.full_like(v, np.nan) if n.startswith(("bend", "frame_tip")) else v
        for n, v in good.columns.items()
    }
    check_recording(Recording("run", good.time, columns, good.info), SPECIMEN)


def test_a_recording_without_any_motion_that_was_read_is_refused(good: Recording) -> None:
    columns = {n: v if n.startswith("pressure") else np.full_like(v, np.nan) for n, v in good.columns.items()}
    bends = {n: v for n, v in columns.items() if n.startswith(("pressure", "bend"))}
    with pytest.raises(InputError, match="no reading of its motion can be fitted"):
        arrange(Recording("run", good.time, bends, good.info), SPECIMEN, ("base", "intermediate", "tip"))


def _require(sentences: tuple[str, ...], words: str) -> None:
    assert any(re.search(words, sentence) for sentence in sentences), sentences


def _require_alike(corrected: Recording, good: Recording) -> None:
    """Motion in the base frame, and the pressures that caused it, agree again with those of the good one."""
    names = (
        "bend_tip_x_rad",
        *(f"{body}_{axis}_m" for body in ("frame_tip", "marker_tip0") for axis in "xyz"),
    )
    pairs = [
        [_relation(recording, name) for recording in (corrected, good)]
        for name in names
        if name in good.columns
    ]
    largest = max(np.abs(other).max() for _, other in pairs)
    for one, other in pairs:
        np.testing.assert_allclose(one, other, atol=0.06 * largest)


def _relation(recording: Recording, name: str) -> np.ndarray:
    """Regress a reading on the pressures: what a calibration would take from the recording."""
    columns = [recording.columns[f"pressure_{k}_pa"] for k in range(6)]
    design = np.column_stack([*columns, np.full(len(recording.time), 1e5)])
    values = _in_base(recording, name)
    seen = np.isfinite(values) & np.isfinite(design).all(axis=1)
    return np.linalg.lstsq(design[seen], values[seen], rcond=None)[0]


def _in_base(recording: Recording, name: str) -> np.ndarray:
    """Bring a column of positions to the base frame, as the recording's own base registers it."""
    kind, _, rest = name.partition("_")
    if kind == "bend":
        return recording.columns[name]
    body, axis, _ = rest.rsplit("_", 2)
    places = recording.pose(body)[:, :3] if kind == "frame" else recording.marker(body)
    registration = arrange(recording, SPECIMEN, ("base", "intermediate", "tip")).registration
    return registration.to_base(places)[:, "xyz".index(axis)]


def test_the_scatter_of_vented_valves_is_no_pressure_in_another_unit() -> None:
    rng = np.random.default_rng(4)
    readings = {f"pressure_{k}_pa": 100.0 * np.round(rng.normal(0.0, 0.3, 900)) for k in range(6)}
    vented = arm.small_arm(seconds=45.0)
    columns = {
        name: np.zeros(900) if "cmd" in name else values[:900] for name, values in vented.columns.items()
    }
    bends = {name: rng.normal(0.0, 1e-3, 900) for name in columns if name.startswith("bend_")}
    recording = Recording(vented.name, vented.time[:900], {**columns, **readings, **bends}, vented.info)
    assert check_recording(recording, SPECIMEN).mismatches == ()


def test_chambers_that_are_filled_alike_do_not_turn_radians_into_degrees() -> None:
    """What valves do apart, a few percent, goes with creep; a slope by it is no bend per pressure."""
    time = np.arange(0.0, 60.0, 0.05)
    together, apart = 20e3 * (1.0 - np.cos(0.2 * time)), 300.0 * np.sin(0.3 * time)
    filled = {"pressure_0_pa": together + apart, "pressure_1_pa": together - apart}
    bends = {
        "bend_tip_x_rad": 0.8 * together / arm.LIMIT + 0.25 * apart / 300.0,
        "bend_tip_y_rad": 0.1 * together / arm.LIMIT,
    }
    recording = Recording("alike", time, filled | bends)
    assert correct_units(recording, arm.specimen()) == (recording, ())


def test_a_recording_of_three_chambers_is_refused_for_an_arm_of_six_whatever_file_it_names() -> None:
    whole = arm.small_arm(seconds=20.0)
    columns = {k: v for k, v in whole.columns.items() if not re.match(r"pressure_(cmd_)?[345]_", k)}
    recording = Recording("mine", whole.time, columns, {"specimen": "/somewhere/tri.toml"})
    (refusal,) = check_recording(recording, SPECIMEN).refusals
    assert "it has chambers 0, 1, 2, the specimen has 6" in str(refusal)


def _frozen(recording: Recording, rows: slice, *, live: str = "") -> Recording:
    """Repeat the first reading of every pressure in some rows; ``live`` columns go on."""
    columns = {name: values.copy() for name, values in recording.columns.items()}
    for name in columns:
        if name.startswith("pressure_") and not (live and name.startswith(live)):
            columns[name][rows] = columns[name][rows][0]
    return Recording(recording.name, recording.time, columns, recording.info)


@pytest.mark.parametrize(("rows", "begin"), [(slice(0, None), 2.0), (slice(900, None), 46.0)])
def test_pressures_that_are_frozen_while_the_arm_moves_are_named_and_left_out(
    good: Recording, rows: slice, begin: float
) -> None:
    intake = check_recording(_frozen(good, rows), SPECIMEN)
    (sentence,) = intake.sentences
    assert re.search(
        r"every pressure reads one and the same number while \w+ moves by .* there and back", sentence
    )
    inside = (good.time > begin) & (good.time < 75.0)
    assert not np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][inside]).any()
    before = good.time < good.time[rows.start] - 1.0
    assert np.isfinite(intake.for_fits.columns["bend_tip_x_rad"][before]).all()


@pytest.mark.usefixtures("without_events")
def test_pressures_that_rest_while_the_arm_swings_creeps_or_is_pulled_are_not_frozen(good: Recording) -> None:
    time = good.time
    rest = {name: np.full(len(time), 2e4) for name in good.columns if name.startswith("pressure_")}
    swing = 0.5 * np.exp(-time / 5.0) * np.cos(9.0 * time) + 0.3 * np.exp(-time / 10.0)
    left = {"bend_tip_x_rad": swing, "bend_tip_y_rad": 0.2 * swing}
    assert not check_recording(Recording("run", time, rest | left, good.info), SPECIMEN).sentences
    pulled = {"bend_tip_x_rad": 0.3 * np.sin(0.2 * time), "bend_tip_y_rad": 0.0 * time}
    gauge = {"gauge_cord_n": 0.5 * np.abs(np.sin(0.2 * time)) + 0.1}
    assert not check_recording(Recording("run", time, rest | pulled | gauge, good.info), SPECIMEN).sentences


def test_a_sensor_that_stands_still_is_no_event(good: Recording) -> None:
    columns = dict(good.columns)
    for name in (name for name in columns if name.startswith("frame_tip")):
        columns[name] = np.where(good.time > 60.0, columns[name][1200], columns[name])
    assert check_recording(Recording("run", good.time, columns, good.info), SPECIMEN).events == ()


def test_a_frozen_sensor_whose_set_point_goes_on_loses_nothing(good: Recording) -> None:
    intake = check_recording(_frozen(good, slice(400, None), live="pressure_cmd"), SPECIMEN)
    assert not intake.excluded
