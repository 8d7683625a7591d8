"""Every error is one line that names the file, the column, the row and the cure."""

import time
from pathlib import Path

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.recordings import load_recording, output_file, save_recording

PRESSURES = "".join(f"{i / 100},{1000.0 * i}\n" for i in range(40))
LOW = "".join(f"{i / 100},{1.5 * i}\n" for i in range(40))
NOISE = "".join(f"{i / 100},{30 * (-1) ** i}\n" for i in range(40))
POSE = "t_s,frame_tip_x_m,frame_tip_y_m,frame_tip_z_m,frame_tip_qw,frame_tip_qx,frame_tip_qy,frame_tip_qz\n"

CASES = {
    "empty": ("", "is empty"),
    "header only": ("t_s,pressure_0_pa\n", "holds no samples"),
    "no time": ("time,pressure_0_pa\n0,1\n", "'time'.*nearest is t_s"),
    "missing time": ("pressure_0_pa\n1\n", "column t_s is missing"),
    "milliseconds": ("t_ms,pressure_0_pa\n0,1\n", "is in ms.*multiply it by 0.001 and name it t_s"),
    "mbar": ("t_s,pressure_0_mbar\n0,1\n", "is in mbar.*multiply it by 100 and name it pressure_0_pa"),
    "kpa": ("t_s,pressure_cmd_3_kPa\n0,1\n", "multiply it by 1000 and name it pressure_cmd_3_pa"),
    "degrees": ("t_s,bend_tip_x_deg,bend_tip_y_deg\n0,1,1\n", "by 0.01745329 and name it bend_tip_x_rad"),
    "millimetres": ("t_s,marker_a_x_mm\n0,1\n", "multiply it by 0.001 and name it marker_a_x_m"),
    "a plain axis": ("t_s,Tip X\n0,1\n", "'Tip X'.*nearest is frame_tip_x_m .docs/recordings.md"),
    "misspelt": ("t_s,presure_2_pa\n0,1\n", "'presure_2_pa'.*nearest is pressure_2_pa"),
    "leading zero": ("t_s,pressure_00_pa\n0,1\n", "nearest is pressure_0_pa"),
    "foreign column": ("t_s,pressure_0_pa,temperature\n0,1,2\n", "'temperature'.*rename or remove"),
    "duplicate": ("t_s,pressure_0_pa,pressure_0_pa\n0,1,2\n", "occurs twice, at positions 2 and 3"),
    "half a bend": ("t_s,bend_tip_x_rad\n0,1\n", "bend_tip_y_rad: is missing, but bend_tip_x_rad is there"),
    "no channel": ("t_s\n0\n1\n", "no usable channel"),
    "empty cells": ("t_s,pressure_0_pa\n0,\n1,\n", "every cell is empty"),
    "text": ("t_s,pressure_0_pa\n0,1\n1,off\n", r"_pa, row 2 \(line 3\): 'off' is not a number"),
    "comma decimals": ("t_s,pressure_0_pa\n0,1,5\n", r"row 1 \(line 2\): has 3 cells, the header 2"),
    "cut off": ("t_s,pressure_0_pa,gauge_a_n\n0,15,1\n1,1", r"row 2 \(line 3\): has 2 cells, the header 3"),
    "short row": ("t_s,pressure_0_pa\n0,1500\n1\n2,1500\n", r"row 2 \(line 3\): has 1 cells, the header 2"),
    "semicolons": ("t_s;pressure_0_pa\n0;1\n", "not separated by commas"),
    "time lost": ("t_s,pressure_0_pa\n0,1\n,2\n", r"column t_s, row 2 \(line 3\): the time is empty"),
    "time nan": ("t_s,pressure_0_pa\n0,1\nNaN,2\n", r"row 2 \(line 3\): the time is empty or not a number"),
    "time repeats": ("t_s,pressure_0_pa\n0,1\n0.5,2\n0.5,3\n", r"row 3 \(line 4\): time repeats 0.5 s"),
    "time goes back": ("t_s,pressure_0_pa\n0,1\n0.5,2\n0.4,3\n", "goes back from 0.5 to 0.4 s"),
    "infinite": ("t_s,pressure_0_pa\n0,inf\n", "the value is infinite"),
    "values in kpa": ("t_s,pressure_0_pa\n" + LOW, "only 58.5, which cannot be Pa.*multiply by 1000 if kPa"),
    "huge pressure": ("t_s,pressure_0_pa\n0,3e9\n", "3e[+]09 cannot be Pa"),
    "values in mm": ("t_s,marker_a_x_m,marker_a_y_m,marker_a_z_m\n0,1,1,1\n1,1,120,1\n", "120 cannot be m.*"),
    "values in degrees": ("t_s,bend_tip_x_rad,bend_tip_y_rad\n0,1,45\n", "45 cannot be rad"),
    "no quaternion": (POSE + "0,0,0,0,0,0,0,0\n", "has norm 0, not 1"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_mistake_is_one_line(case: str, tmp_path: Path) -> None:
    content, message = CASES[case]
    path = tmp_path / "run.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.cure


@pytest.mark.parametrize("content", [PRESSURES, NOISE, "0,0\n1,0\n", '0, 1.5e3 \n1,"2000"\n'])
def test_good_tables_load(content: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t_s,pressure_0_pa\n" + content)
    assert load_recording(path).chambers == (0,)


def test_a_stated_unit_settles_low_pressures(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t_s,pressure_0_pa\n" + LOW)
    (tmp_path / "run.toml").write_text('pressure_unit = "Pa"\n')
    assert load_recording(tmp_path / "run.csv").pressure(0)[0].max() == 58.5


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("specimen = 5", "specimen: is 5; give the path or name"),
        ('rate_hz = "fast"', "rate_hz: is 'fast'; give samples per second"),
        ("rate_hz = -5", "rate_hz: is -5;"),
        ('session_start_s = "noon"', "session_start_s: is 'noon'; give seconds"),
        ("gravity_m_s2 = [0.0, 9.81]", "gravity_m_s2: is .0.0, 9.81.; give x, y and z"),
        ("gravity_m_s2 = [0.0, 0.0, 9810.0]", "gravity_m_s2: is .*9810.*in m/s2"),
        ("gravity_m_s2 = [0.0, 0.0, 1.0]", "gravity_m_s2: is .*in m/s2"),
        ("gauge_direction = [0, 0, 0]", "gauge_direction: is .*give x, y and z of the pull"),
        ("gauge_section = 2", "gauge_section: is 2; give the name of a section"),
    ],
)
def test_what_is_said_of_a_run_must_be_usable(line: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t_s,pressure_0_pa\n" + PRESSURES)
    (tmp_path / "run.toml").write_text(line + "\n")
    with pytest.raises(InputError, match=rf"run\.toml, {message}"):
        load_recording(tmp_path / "run.csv")


def test_bytes_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes("\ufefft_s,gauge_a_n\r\n0,1\r\n1,2\r\n".encode())
    assert load_recording(tmp_path / "run.csv").gauge("a").tolist() == [1.0, 2.0]


def test_broken_toml_names_its_line(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t_s,gauge_a_n\n0,1\n")
    (tmp_path / "run.toml").write_text("specimen = \n")
    with pytest.raises(InputError, match=r"run.toml: is not TOML .*line 1"):
        load_recording(tmp_path / "run.csv")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.parquet", b"no parquet", "cannot be read as Parquet"),
        ("x.mcap", b"no mcap at all", "is not an MCAP file"),
        ("x.mcap", b"", "is not an MCAP file"),
        ("x.c3d", b"no c3d", "cannot be read as C3D"),
        ("x.tsv", b"a\tb\n", "DATA_INCLUDED"),
        ("x.xlsx", b"", "is not read"),
        ("x.csv", b"\xff\xfe\x00", "is not a text file"),
    ],
)  # fmt: skip
def test_files_of_the_wrong_kind(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        load_recording(tmp_path / name)


def test_paths_that_hold_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file or folder"):
        load_recording(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"holds no recording.csv"):
        load_recording(tmp_path)


def test_parquet_of_text_is_refused(tmp_path: Path) -> None:
    import polars as pl

    pl.DataFrame({"t_s": [0.0], "gauge_a_n": ["x"]}).write_parquet(tmp_path / "x.parquet")
    with pytest.raises(InputError, match="column gauge_a_n: holds String, not numbers"):
        load_recording(tmp_path / "x.parquet")


@pytest.mark.parametrize("end", ["", "\n\n", "\r\n\r\n", "\n \n"])
def test_blank_lines_at_the_end_are_passed_over(end: str, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(f"t_s,pressure_0_pa\n0,1500\n1,{end}".encode())
    assert load_recording(tmp_path / "x.csv").time.tolist() == [0.0, 1.0]
    (tmp_path / "x.csv").write_bytes(f"t_s,pressure_0_pa\n0,1500{end}".encode())
    assert load_recording(tmp_path / "x.csv").pressure(0)[0].tolist() == [1500.0]


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mcap"])
def test_a_suffix_may_be_in_capitals(small: Recording, suffix: str, tmp_path: Path) -> None:
    save_recording(small, tmp_path / f"x.{suffix}")
    (tmp_path / f"x.{suffix}").rename(tmp_path / f"X.{suffix.upper()}")
    if suffix != "mcap":
        (tmp_path / "x.toml").rename(tmp_path / "X.toml")
    assert load_recording(tmp_path / f"X.{suffix.upper()}").info == small.info


def test_nothing_is_replaced_unasked(small: Recording, tmp_path: Path) -> None:
    save_recording(small, tmp_path / "x.csv")
    with pytest.raises(InputError, match="exists already"):
        save_recording(small, tmp_path / "x.csv")
    save_recording(small, tmp_path / "x.csv", force=True)


@pytest.mark.parametrize("there", ["x.toml", "specimen.toml"])
def test_no_file_beside_a_table_is_replaced_unasked(small: Recording, tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_text("mine = 1\n")
    attachments = {"specimen.toml": b'name = "sopra"\n'}
    with pytest.raises(InputError, match=f"{there}: exists already"):
        save_recording(small, tmp_path / "x.csv", attachments=attachments)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(there, "mine = 1\n")]
    save_recording(small, tmp_path / "x.csv", attachments=attachments, force=True)
    assert (tmp_path / there).read_text() != "mine = 1\n"


def test_files_that_hold_the_same_are_shared(small: Recording, tmp_path: Path) -> None:
    attachments = {"specimen.toml": b'name = "sopra"\n'}
    save_recording(small, tmp_path / "x.csv", attachments=attachments)
    (tmp_path / "x.toml").write_bytes(b"# mine\n" + (tmp_path / "x.toml").read_bytes())
    assert save_recording(small, tmp_path / "x.parquet", attachments=attachments) == (tmp_path / "x.parquet",)
    assert (tmp_path / "x.toml").read_text().startswith("# mine")


def test_the_place_of_an_estimate_is_free_with_all_its_files(tmp_path: Path) -> None:
    (tmp_path / "x.toml").touch()
    with pytest.raises(InputError, match=r"x\.toml: exists already"):
        output_file(tmp_path / "x.csv", force=False)
    assert output_file(tmp_path / "x.csv", force=True) == tmp_path / "x.csv"
    assert output_file(tmp_path / "x.mcap", force=False) == tmp_path / "x.mcap"


def test_nothing_is_written_half(small: Recording, tmp_path: Path) -> None:
    unwritable = Recording(small.name, small.time, small.columns, {"a": object()})
    for target in ("new/x.csv", "new/x.mcap", "new/x.parquet"):
        with pytest.raises(TypeError):
            save_recording(unwritable, tmp_path / target)
    assert list(tmp_path.iterdir()) == []


def test_unknown_output_format(small: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.xlsx is not written; end the path in \.csv"):
        save_recording(small, tmp_path / "x.xlsx")


def test_a_minute_of_csv_loads_fast(tmp_path: Path) -> None:
    time_s = np.arange(7500) * 0.01
    columns = {f"pressure_{k}_pa": 1e4 * np.sin(time_s + k) for k in range(12)}
    save_recording(Recording("long", time_s, columns), tmp_path / "long.csv")
    start = time.process_time()
    load_recording(tmp_path / "long.csv")
    assert time.process_time() - start < 0.2
