"""The directions in which chambers bend an arm."""

import numpy as np
import pytest

from softarm.estimator.intake.bending import bending_directions
from softarm.estimator.intake.mounts import check_mount
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen


def test_a_beam_without_chambers_bends_in_no_direction_of_theirs() -> None:
    time = 0.1 * np.arange(50)
    still = Recording("beam", time, {"marker_tip0_x_m": np.zeros(50)})
    assert bending_directions(still, load_specimen("beam"), ()) is None


SINGLE = load_specimen("single_segment")


def _stepped(chamber: int, *, frames: bool = False, sideways: float = 0.0) -> Recording:
    """Fill chamber 0 for a second, let the arm swing, and write the set-point as that of some chamber.

    Args:
        chamber: Whose set-point it is said to be.
        frames: Whether the frames of both sections were recorded, else their markers.
        sideways: Share of the motion that goes across.
    """
    time = 0.01 * np.arange(200)
    rng = np.random.default_rng(3)
    step = ((time >= 0.3) & (time < 1.3)).astype(float)
    swing = sum(
        sign * (time >= at) * (1.0 - np.cos(12.0 * (time - at)) * np.exp(-(time - at)))
        for at, sign in ((0.3, 1.0), (1.3, -1.0))
    )
    columns = {f"pressure_cmd_{chamber}_pa": 30e3 * step}
    away = -0.01 * swing * np.exp(1j * SINGLE.chambers[0].azimuth_rad)
    aside = sideways * 0.01 * np.sin(5.0 * time)
    for marker in SINGLE.markers:
        section = SINGLE.section(marker.section)
        place = np.array(section.frame_origin_m) + (0.0 if frames else np.array(marker.offset_m))
        moved = place + rng.normal(0.0, 5e-5, (len(time), 3))
        if section.name == "tip":
            moved[:, :2] += np.column_stack([away.real, away.imag + aside])
        name = f"frame_{section.name}" if frames else f"marker_{marker.name}"
        columns |= {f"{name}_{axis}_m": values for axis, values in zip("xyz", moved.T, strict=True)}
        if frames:
            columns |= {f"{name}_q{letter}": np.full(len(time), float(letter == "w")) for letter in "wxyz"}
    return Recording("run", time, columns, {"specimen": "single_segment"})


def test_one_chamber_that_swings_the_arm_along_its_azimuth_is_left_alone() -> None:
    assert check_mount(_stepped(0), SINGLE)[1] == ()


@pytest.mark.parametrize(("chamber", "angle"), [(1, "-90"), (2, "180"), (3, "90")])
def test_one_chamber_that_bends_the_arm_as_another_would_is_refused(chamber: int, angle: str) -> None:
    _, (fault,) = check_mount(_stepped(chamber), SINGLE)
    assert not fault.corrected
    assert f"rotated by {angle} degrees about its axis, as the base registers it" in fault.what


def test_without_markers_of_the_base_the_laboratory_may_be_mirrored_instead() -> None:
    _, (fault,) = check_mount(_stepped(1, frames=True), SINGLE)
    assert "rotated by -90 degrees about its axis, or the laboratory is mirrored" in fault.what


def test_one_chamber_of_an_arm_that_moves_in_all_directions_shows_none() -> None:
    assert check_mount(_stepped(2, sideways=3.0), SINGLE)[1] == ()


def test_markers_that_the_specimen_does_not_describe_are_named_where_the_base_is_missing() -> None:
    tips = tuple(marker for marker in SINGLE.markers if marker.section == "tip")
    _, (fault,) = check_mount(_stepped(2), SINGLE.model_copy(update={"markers": tips}))
    assert "nothing of the base was read" in fault.what
    assert "describe the markers of the base in the specimen" in fault.cure
    assert "base1, base2, base3" in fault.cure
