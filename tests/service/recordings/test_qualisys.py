from pathlib import Path

import ezc3d
import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.recordings import load_recording

HEADER_3D = (
    "NO_OF_FRAMES\t2\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nNO_OF_ANALOG\t0\n"
    "DESCRIPTION\t--\nTIME_STAMP\t2021-07-09, 12:00:00.000\t1234.5\n"
    "DATA_INCLUDED\t3D\nMARKER_NAMES\tTip - 1\tBase\n"
)
HEADER_6D = "FREQUENCY\t100\nDATA_INCLUDED\t6D\nBODY_NAMES\tPSVH\n"
BODY = "\t".join(["PSVH X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{i}]" for i in range(9))])
# One row as the program exports it: roll -0.6563, pitch 0.0939, yaw 0.0577 degrees.
POSE = (
    "-194.91974 2.24150 0.99661 -0.65630 0.09391 0.05772 4.98536 "
    "1.00000 0.00099 -0.00165 -0.00101 0.99993 -0.01145 0.00164 0.01145 0.99993"
).replace(" ", "\t")
LOST = "\t".join(["0.00000"] * 6 + ["-1.00000"] + ["0.00000"] * 9)


def test_markers_in_metres_with_lost_ones(tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_text(HEADER_3D + "100\t200\t300\t1\t2\t3\n0\t0\t0\t4\t5\t6\n")
    recording = load_recording(tmp_path / "a.tsv")
    assert recording.markers == ("Tip_1", "Base")
    assert recording.time.tolist() == [0.0, 0.01]
    np.testing.assert_allclose(recording.marker("Tip_1"), [[0.1, 0.2, 0.3], [np.nan] * 3])


def test_frame_and_time_columns_and_a_map(tmp_path: Path) -> None:
    rows = "1\t0.50000\t100\t200\t300\t1\t2\t3\n2\t0.51000\t\t\t\t4\t5\t6\n"
    (tmp_path / "a.tsv").write_text(HEADER_3D + "Frame\tTime\tTip - 1 X\tTip - 1 Y\n" + rows)
    (tmp_path / "map.toml").write_text('specimen = "beam"\n[markers]\n"Tip - 1" = "tip1"\n')
    recording = load_recording(tmp_path / "a.tsv", tmp_path / "map.toml")
    assert recording.markers == ("tip1",)
    assert recording.time.tolist() == [0.5, 0.51]
    assert np.isnan(recording.marker("tip1")[1]).all()
    assert recording.info == {"specimen": "beam"}


def test_rigid_bodies_become_frames(tmp_path: Path) -> None:
    rows = f"1\t0.00000\t{POSE}\n2\t0.01000\t{LOST}\n"
    (tmp_path / "a.tsv").write_text(HEADER_6D + f"Frame\tTime\t{BODY}\n" + rows)
    (tmp_path / "a.toml").write_text('[bodies]\nPSVH = "tip"\n')
    pose = load_recording(tmp_path / "a.tsv").pose("tip")
    np.testing.assert_allclose(pose[0, :3], [-0.19491974, 0.0022415, 0.00099661])
    half = np.radians([-0.65630, 0.09391, 0.05772]) / 2
    np.testing.assert_allclose(pose[0, 4:], half, atol=2e-5)
    assert np.isnan(pose[1]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER_3D, "holds no samples"),
        (HEADER_3D + "1\t2\t3\t4\t5\n", "has 5 cells, the header names 6"),
        (HEADER_3D + "1\t2\t3\t4\t5\tx\n", r"line 10: 'x' is not a number"),
        (HEADER_3D.replace("Tip - 1\tBase", "") + "1\t2\n", "MARKER_NAMES: names nothing"),
        (HEADER_3D.replace("100", "EXT") + "1\t2\t3\t4\t5\t6\n", "FREQUENCY: is EXT"),
        (HEADER_3D.replace("Base", "Tip_1") + "1\t2\t3\t4\t5\t6\n", "two of them are called 'Tip_1'"),
    ],
)  # fmt: skip
def test_mistakes_in_an_export(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_text(text)
    with pytest.raises(InputError, match=message):
        load_recording(tmp_path / "a.tsv")


def test_a_map_that_names_no_label(tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_text(HEADER_3D + "1\t2\t3\t4\t5\t6\n")
    (tmp_path / "a.toml").write_text('[markers]\nTop = "tip1"\n')
    with pytest.raises(InputError, match="there is no 'Top'; the export has: Tip - 1, Base"):
        load_recording(tmp_path / "a.tsv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('markers = ["Tip - 1"]', r"markers: is \['Tip - 1'\], not a table"),
        ("markers = 3", "markers: is 3, not a table"),
        ('[markers]\n"Tip - 1" = 3', "markers: 'Tip - 1' is 3, not a name"),
    ],
)
def test_a_map_that_is_no_table_of_names(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.tsv").write_text(HEADER_3D + "1\t2\t3\t4\t5\t6\n")
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        load_recording(tmp_path / "a.tsv")


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e-3), ("m", 1.0)])
def test_c3d_points(unit: str, factor: float, tmp_path: Path) -> None:
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["RATE"]["value"] = [50.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["tip1", "base1"]
    points = np.ones((4, 2, 3))
    points[:3] = np.arange(1, 19).reshape(3, 2, 3)
    points[:3, 0, 1] = np.nan
    file["data"]["points"] = points
    file.write(str(tmp_path / "a.c3d"))
    recording = load_recording(tmp_path / "a.c3d")
    assert recording.time.tolist() == [0.0, 0.02, 0.04]
    np.testing.assert_allclose(recording.marker("base1"), points[:3, 1].T * factor, rtol=1e-6)
    assert np.isnan(recording.marker("tip1")[1]).all()
    np.testing.assert_allclose(recording.marker("tip1")[[0, 2]], points[:3, 0, [0, 2]].T * factor, rtol=1e-6)
