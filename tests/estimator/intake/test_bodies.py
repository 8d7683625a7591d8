"""Markers of one rigid body: exchanged for a while, standing still, and off their places."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.intake import mismatch_finding
from softarm.estimator.intake.bodies import correct_places
from softarm.estimator.intake.exchanges import correct_exchanges
from softarm.estimator.intake.stuck import correct_stuck
from softarm.estimator.recording import Recording
from softarm.estimator.specimen.body import Marker
from tests.estimator.intake import small_arm as arm

SPECIMEN = arm.specimen()


@pytest.fixture(scope="module")
def good() -> Recording:
    return arm.small_arm(parts=("marker",))


def _exchanged(recording: Recording, names: tuple[str, ...], since: float, until: float) -> Recording:
    """Give each marker the name of the next one for a while."""
    during = (recording.time >= since) & (recording.time < until)
    columns = dict(recording.columns)
    for one, other in zip(names, (*names[1:], names[0]), strict=True):
        for axis in "xyz":
            name, source = (f"marker_{marker}_{axis}_m" for marker in (one, other))
            columns[name] = np.where(during, recording.columns[source], recording.columns[name])
    return replace(recording, columns=columns)


def _moved(recording: Recording, marker: str, by: tuple[float, float, float]) -> Recording:
    """Move a marker in its body."""
    framed = arm.small_arm(parts=("frame", "marker"))
    turns = arm.from_quaternions(framed.pose(marker[:-1])[:, 3:])
    moved = recording.marker(marker) + turns @ np.array(by)
    columns = {f"marker_{marker}_{axis}_m": moved[:, k] for k, axis in enumerate("xyz")}
    return replace(recording, columns={**recording.columns, **columns})


@pytest.mark.parametrize("seed", range(4))
def test_markers_that_keep_their_distances_are_left_alone(seed: int) -> None:
    recording = arm.small_arm(seed)
    for correct in (correct_exchanges, correct_stuck, correct_places):
        assert correct(recording, SPECIMEN) == (recording, ())


@pytest.mark.parametrize(("since", "until"), [(40.0, 80.0), (0.0, 30.0), (20.0, 20.5)])
@pytest.mark.parametrize("names", [("tip0", "tip1"), ("tip0", "tip1", "tip2"), ("base1", "base2")])
def test_markers_that_are_exchanged_for_a_while_are_corrected(
    good: Recording, names: tuple[str, ...], since: float, until: float
) -> None:
    corrected, (fault,) = correct_exchanges(_exchanged(good, names, since, until), SPECIMEN)
    assert fault.corrected
    words = f"from {since:.2f} to {until - 1.0 / arm.RATE:.2f} s: between two samples they jump by"
    assert words in fault.statement
    assert ("exchanged" if len(names) == 2 else "permuted") in fault.statement
    for name, values in good.columns.items():
        np.testing.assert_array_equal(corrected.columns[name], values)


def test_names_between_stretches_are_not_known_where_a_marker_was_not_seen(good: Recording) -> None:
    exchanged = _exchanged(good, ("tip0", "tip1"), 40.0, 80.0)
    unseen = (good.time > 39.0) & (good.time < 41.0)
    lost = {
        f"marker_tip2_{axis}_m": np.where(unseen, np.nan, good.marker("tip2")[:, k])
        for k, axis in enumerate("xyz")
    }
    corrected, _ = correct_exchanges(replace(exchanged, columns={**exchanged.columns, **lost}), SPECIMEN)
    assert np.isnan(corrected.marker("tip0")[unseen]).all()
    np.testing.assert_array_equal(corrected.marker("tip0")[~unseen], good.marker("tip0")[~unseen])


def test_exchanged_markers_of_alike_places_are_refused_without_the_base(good: Recording) -> None:
    alike = tuple(
        Marker(name=f"tip{k}", section="tip", offset_m=place)
        for k, place in enumerate(((0.03, 0.0, 0.0), (-0.02, 0.025, 0.0), (-0.02, -0.025, 0.0)))
    )
    specimen = SPECIMEN.model_copy(update={"markers": alike})
    framed = arm.small_arm(parts=("frame",))
    turns, pose = arm.from_quaternions(framed.pose("tip")[:, 3:]), framed.pose("tip")[:, :3]
    columns = {n: v for n, v in framed.columns.items() if n.startswith("pressure")}
    for marker in alike:
        place = pose + turns @ np.array(marker.offset_m)
        columns |= {f"marker_{marker.name}_{axis}_m": place[:, k] for k, axis in enumerate("xyz")}
    recording = Recording("run", good.time, columns, {})
    _, (fault,) = correct_exchanges(_exchanged(recording, ("tip1", "tip2"), 40.0, 80.0), specimen)
    assert not fault.corrected
    assert "correct the names in the export" in fault.statement


@pytest.mark.parametrize("seconds", [1.5, 80.0])
@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_a_marker_that_stands_still_in_a_moving_body_is_stuck(
    good: Recording, noise: float, seconds: float
) -> None:
    """However short the recording: the first motion begins at 2 s."""
    window = good.window((good.time >= 2.0) & (good.time < 2.0 + seconds))
    rng = np.random.default_rng(1)
    held = {
        f"marker_tip0_{axis}_m": window.marker("tip0")[0, k] + noise * rng.normal(size=len(window.time))
        for k, axis in enumerate("xyz")
    }
    corrected, (fault,) = correct_stuck(replace(window, columns={**window.columns, **held}), SPECIMEN)
    assert "while its distance from others of its body changes by" in fault.statement
    assert "tip0" not in corrected.markers
    finding = mismatch_finding(fault)
    assert (finding.effect, finding.where.sensor) == ("sensor_stuck", "marker_tip0")


def test_a_marker_of_the_base_with_the_name_of_another_body_is_not_stuck(good: Recording) -> None:
    named = arm.exchanged("marker_tip0", "marker_base1")(good)
    assert correct_stuck(named, SPECIMEN) == (named, ())


@pytest.mark.parametrize("marker", ["tip0", "tip2"])
def test_a_marker_off_its_place_is_left_out_where_it_alone_can_be(good: Recording, marker: str) -> None:
    corrected, (fault,) = correct_places(_moved(good, marker, (0.003, 0.0045, 0.0)), SPECIMEN)
    assert f"marker {marker} is off its place in its body" in fault.statement
    assert marker not in corrected.markers
    assert len(corrected.markers) == 5


def test_a_marker_off_its_place_is_used_where_another_may_be_off_instead(good: Recording) -> None:
    along = np.subtract(arm.BODIES["tip"][0], arm.BODIES["tip"][1])
    across = np.subtract(arm.BODIES["tip"][0], arm.BODIES["tip"][2])
    by = np.cross(across, np.cross(along, across))
    recording = _moved(good, "tip0", tuple(0.004 * by / np.linalg.norm(by)))
    corrected, (fault,) = correct_places(recording, SPECIMEN)
    assert "tip0 or tip1 is off the place in the specimen" in fault.statement
    assert corrected == recording


def test_a_base_keeps_the_three_markers_that_register_it(good: Recording) -> None:
    recording = _moved(good, "base0", (0.004, 0.004, 0.0))
    corrected, (fault,) = correct_places(recording, SPECIMEN)
    assert "used as they are" in fault.statement
    assert corrected == recording
