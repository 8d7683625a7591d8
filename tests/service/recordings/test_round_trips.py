import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.estimator.recording import Recording
from softarm.recordings import load_recording, read_attachments, save_recording
from softarm.recordings.columns import column_name, place

CELL = st.one_of(st.just(float("nan")), st.floats(-40.0, 40.0), st.floats(-1e-300, 1e-300))
UNIT_CELL = st.sampled_from([float("nan"), 0.25, -1.0])
NAME = st.from_regex(r"[a-z][a-z0-9]{0,3}(?:[_-][A-Z0-9]{1,2})?", fullmatch=True)


def assert_same(one: Recording, other: Recording) -> None:
    assert list(one.columns) == list(other.columns)
    assert np.array_equal(one.time, other.time)
    for name, values in one.columns.items():
        assert np.array_equal(values, other.columns[name], equal_nan=True), name
        assert (
            np.array_equal(np.signbit(values), np.signbit(other.columns[name])) or np.isnan(values).any()
        ), name
    assert one.info == other.info


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    times = draw(st.lists(st.floats(-1e4, 1e6), min_size=1, max_size=12, unique=True))
    time = np.sort(np.array(times))
    names: list[str] = []
    for k in draw(st.lists(st.integers(0, 11), max_size=3, unique=True)):
        names += draw(st.sampled_from([[f"pressure_{k}_pa"], [f"pressure_cmd_{k}_pa", f"pressure_{k}_pa"]]))
    for name in draw(st.lists(NAME, max_size=2, unique=True)):
        names += [f"marker_{name}_{axis}_m" for axis in "xyz"]
    for name in draw(st.lists(NAME, max_size=2, unique=True)):
        names += [f"bend_{name}_x_rad", f"bend_{name}_y_rad"]
    names = draw(st.permutations([*names, "gauge_hook_n", "estimate_force_tip_x_n"]))
    columns = {}
    for name in names:
        cells = UNIT_CELL if "rad" in name else CELL
        columns[name] = np.array(draw(st.lists(cells, min_size=len(time), max_size=len(time))))
    columns["gauge_hook_n"][0] = 1.0
    info = draw(
        st.dictionaries(
            st.sampled_from(["specimen", "notes"]),
            st.text(st.characters(codec="utf-8", exclude_characters="\r"), min_size=1, max_size=8),
        )
    )
    return Recording("r", time, columns, {**info, "pressure_unit": "Pa", "rate_hz": 100.0})


@settings(max_examples=40, deadline=None)
@given(recordings())
def test_no_digit_is_lost_from_table_to_table_to_mcap_and_back(recording: Recording) -> None:
    with tempfile.TemporaryDirectory() as folder:
        step = recording
        for number, suffix in enumerate((".csv", ".parquet", ".mcap", ".csv")):
            path = Path(folder) / str(number) / f"r{suffix}"
            save_recording(step, path)
            step = load_recording(path)
            assert_same(recording, step)


@pytest.mark.parametrize("target", ["x.csv", "x.parquet", "x.mcap", "folder"])
def test_every_stream_survives(small: Recording, tmp_path: Path, target: str) -> None:
    save_recording(small, tmp_path / target)
    assert_same(small, load_recording(tmp_path / target))


def test_rows_without_any_reading_are_kept(tmp_path: Path) -> None:
    gap = Recording("gap", np.arange(3.0), {"gauge_hook_n": np.array([1.0, np.nan, 2.0])})
    save_recording(gap, tmp_path / "gap.mcap")
    assert_same(gap, load_recording(tmp_path / "gap.mcap"))


@pytest.mark.parametrize("target", ["x.csv", "x.mcap"])
def test_the_specimen_travels_along(small: Recording, tmp_path: Path, target: str) -> None:
    attachments = {"specimen.toml": b'name = "sopra"\n'}
    save_recording(small, tmp_path / target, attachments=attachments)
    assert read_attachments(tmp_path / target) == attachments


def test_a_folder_gets_the_canonical_names(small: Recording, tmp_path: Path) -> None:
    written = save_recording(small, tmp_path / "run7")
    assert [p.name for p in written] == ["recording.csv", "recording.toml"]
    assert load_recording(tmp_path / "run7").name == "run7"


@pytest.mark.recordings
def test_development_recordings_come_back_from_mcap(development_recordings: Path, tmp_path: Path) -> None:
    for name in ("beam_gravity_v2_a", "single_segment_blackframe_125", "sopra_valve_steps_0-2"):
        recording = load_recording(development_recordings / name)
        save_recording(recording, tmp_path / f"{name}.mcap")
        assert_same(recording, load_recording(tmp_path / f"{name}.mcap"))


@given(
    st.sampled_from(
        [
            "pressure_3_pa",
            "pressure_cmd_11_pa",
            "frame_a_b_qw",
            "bend_tip_x_rad",
            "marker_x_m_z_m",
            "gauge_g-1_n",
            "estimate_status",
        ]
    )
)
def test_places_lead_back_to_columns(column: str) -> None:
    spot = place(column)
    assert spot is not None
    assert column_name(spot.topic, spot.field) == column
