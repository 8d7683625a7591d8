"""What the page of a diagnosis is made of."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.analysis.diagnosis.digest import write_report
from softarm.analysis.diagnosis.motion import load_motions, motion_file, specimen_file, write_motions
from softarm.analysis.diagnosis.report import report_of
from softarm.cli.page import command
from softarm.estimator.diagnosis.motion import HELDOUT, residual_column
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.body import Marker, Segment
from softarm.estimator.specimen.physics import Place
from softarm.page.highlight import nodes_at
from softarm.page.mismatch import MismatchOverTime
from softarm_client.messages import Surface
from tests.service.diagnosis.made_diagnosis import diagnosis
from tests.service.page.test_playback import LENGTH_M, arm, recording

RING = [(0.03, 0.0), (0.0, 0.03), (-0.03, 0.0), (0.0, -0.03)]
SURFACE = Surface(
    triangles=((0, 1, 4), (1, 5, 4)), rest_m=tuple((x, y, z) for z in (0.0, LENGTH_M) for x, y in RING)
)
ARM = arm(
    azimuths=(0.0, np.pi),
    segments=(Segment(name="lower", from_m=0.5 * LENGTH_M, to_m=LENGTH_M, material="silicone"),),
    markers=(Marker(name="m1", section="tip", offset_m=(0.0, 0.0, 0.0)),),
)
REST = np.array(SURFACE.rest_m)
BELOW = REST[:, 2] > 0.0
EVERY, NONE = np.ones(len(REST), dtype=bool), np.zeros(len(REST), dtype=bool)
CHANNEL = "bend_tip.x"


def motion(name="run_03"):
    """A recording whose bend is off by 0.01 rad a second before, by a tenth of it after; a sample is lost."""
    made = recording()
    off = 0.01 * made.time
    off[10] = np.nan
    columns = {
        residual_column("before", CHANNEL, "rad"): off,
        residual_column("after", CHANNEL, "rad"): 0.1 * off,
        HELDOUT: (made.time > 1.05).astype(float),
    }
    return replace(made, name=name, columns={**made.columns, **columns})


def written(folder, **changes):
    """Write a diagnosis to a folder as the command does."""
    found = replace(diagnosis(), motions=(motion(), motion("day 2/run_04")), **changes)
    found = replace(found, recordings=tuple(one.name for one in found.motions))
    write_report(report_of(found), folder)
    write_motions(found, load_specimen("sopra"), folder)
    return found


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        (Place(segment="lower", axis="x"), BELOW),
        (Place(section="base"), ~BELOW),
        (Place(chamber=0), REST[:, 0] >= 0.0),
        (Place(chamber=1), REST[:, 0] <= 0.0),
        (Place(sensor="bend_tip", axis="y"), BELOW),
        (Place(sensor="marker_m1"), BELOW),
        (Place(sensor="pressure_0"), NONE),
        (Place(), NONE),
    ],
)
def test_the_place_of_a_finding_is_found_on_the_surface(where, expected):
    np.testing.assert_array_equal(nodes_at(REST, ARM, where), expected)


def test_a_mismatch_is_given_in_readable_units_and_in_multiples_of_the_noise():
    mismatch = MismatchOverTime(motion(), {CHANNEL: 0.002, "bend_tip.y": 0.002})
    assert mismatch.before[20] == pytest.approx(10.0)
    assert mismatch.after[20] == pytest.approx(1.0)
    assert mismatch.before[10] == 0.0
    assert "<td>1.15 degrees</td><td>0.11 degrees</td>" in mismatch.at(2.0)
    assert "has not used" in mismatch.at(2.0)
    assert mismatch.at(1.0).count("lost") == 2
    assert "has used" in mismatch.at(1.0)


def test_a_diagnosis_without_motion_is_refused_with_the_remedy(tmp_path):
    found = written(tmp_path)
    for name in found.recordings:
        motion_file(tmp_path, name).unlink()
    with pytest.raises(InputError, match="softarm diagnose --force"):
        CliRunner().invoke(
            command, ["--diagnosis", str(tmp_path)], standalone_mode=False, catch_exceptions=False
        )


def test_a_diagnosis_of_valves_leaves_no_motion_of_an_earlier_one(tmp_path):
    found = written(tmp_path)
    write_motions(replace(found, motions=()), load_specimen("beam"), tmp_path)
    assert load_specimen(specimen_file(tmp_path)).name == "beam"
    with pytest.raises(InputError, match="without motion"):
        load_motions(tmp_path, found.recordings)
