"""The shipped places of markers, held against the recordings at rest."""

import os
from pathlib import Path

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.sensing.registration import register
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.recordings import load_recording

BESIDE = Path(__file__).parents[4] / "shared" / "recordings"
RECORDINGS = Path(os.environ.get("SOFTARM_RECORDINGS", BESIDE))

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"no development recordings in {RECORDINGS}"),
]


def places(specimen: Specimen, section: str) -> tuple[list[str], Floats]:
    """Return the markers of a section and their places in the base frame at rest [m]."""
    markers = [marker for marker in specimen.markers if marker.section == section]
    origin = np.array(specimen.section(section).frame_origin_m)
    return [marker.name for marker in markers], origin + np.array([marker.offset_m for marker in markers])


def residuals(name: str, specimen: Specimen, start_s: float, end_s: float) -> tuple[Floats, Floats]:
    """Register the base markers, and give how far base and tip markers are from their places [m]."""
    recording = load_recording(RECORDINGS / name)
    rest = (recording.time >= start_s) & (recording.time <= end_s)
    base, base_places = places(specimen, "base")
    tip, tip_places = places(specimen, "tip")
    seen = {marker: np.nanmean(recording.marker(marker)[rest], axis=0) for marker in base + tip}
    found = register(base_places, np.array([seen[marker] for marker in base]), 2e-4)
    gaps = [
        found.to_base(np.array([seen[marker] for marker in markers])) - points
        for markers, points in ((base, base_places), (tip, tip_places))
    ]
    return np.linalg.norm(gaps[0], axis=1), np.linalg.norm(gaps[1], axis=1)


@pytest.mark.parametrize("kilopascal", ["75", "125", "175", "225", "275", "325", "375"])
def test_single_segment_at_zero_pressure(kilopascal: str) -> None:
    name = f"single_segment_blackframe_{kilopascal}"
    base, tip = residuals(name, load_specimen("single_segment"), 0.0, 0.05)
    assert base.max() < 0.15e-3
    assert tip.max() < 0.5e-3


def test_bare_beam_held_level() -> None:
    base, tip = residuals("beam_gravity_v2_a", load_specimen("beam"), 0.15, 0.6)
    assert base.max() < 0.05e-3
    assert tip.max() < 0.1e-3


def test_loaded_beam_held_level() -> None:
    """The weight was mounted between the runs, which moved the tip's markers by up to 3 mm."""
    base, tip = residuals("beam_load52_v2_a", load_specimen("beam"), 0.15, 0.4)
    assert base.max() < 0.1e-3
    assert tip.max() < 3.0e-3
