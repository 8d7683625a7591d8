import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.offline.inputs import specimen_of
from softarm.analysis.plots.recording import amplitude_spectrum, draw_spectra, draw_streams
from softarm.cli import run
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen, save_specimen
from softarm.recordings import load_recording, save_recording

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def run7(tmp_path: Path) -> Path:
    time = np.arange(300) * 0.01
    swing = 0.1 * np.sin(2 * np.pi * 2.3 * time)
    half = swing / 2
    columns = {
        "pressure_0_pa": 2e4 + 1e4 * swing,
        "pressure_cmd_0_pa": np.full(300, 2e4),
        "bend_tip_x_rad": swing,
        "bend_tip_y_rad": np.where(time > 1, swing, np.nan),
        "marker_a_x_m": swing,
        "marker_a_y_m": swing,
        "marker_a_z_m": 0 * swing,
        "gauge_hook_n": swing,
        "estimate_force_tip_x_n": swing,
        "estimate_force_tip_x_std_n": 0.1 + 0 * swing,
    }
    columns |= {f"frame_tip_{axis}_m": swing for axis in "xyz"}
    columns |= {"frame_tip_qw": np.cos(half), "frame_tip_qx": np.sin(half)}
    columns |= {"frame_tip_qy": 0 * half, "frame_tip_qz": 0 * half}
    save_recording(Recording("run7", time, columns, {"specimen": "sopra"}), tmp_path / "run7")
    return tmp_path / "run7"


def test_convert_there_and_back(run7: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mcap, csv = run7.parent / "x.mcap", run7.parent / "back.csv"
    assert run(["convert", str(run7), str(mcap), "--json"]) == 0
    rows = {row["stream"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["bend/tip"]["readings"] == 300
    assert rows["pressures"]["rate_hz"] == pytest.approx(100)
    assert run(["convert", str(mcap), str(csv)]) == 0
    assert csv.read_bytes() == (run7 / "recording.csv").read_bytes()


def test_convert_refuses_what_is_there(run7: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = run7.parent / "x.parquet"
    assert run(["convert", str(run7), str(target)]) == 0
    assert run(["convert", str(run7), str(target)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--force" in error
    assert run(["convert", str(run7), str(target), "--force"]) == 0


def test_a_map_that_would_not_be_read_is_refused(run7: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run7.parent / "export.tsv").touch()
    (run7.parent / "map.toml").touch()
    for source, column_map, words in (
        ("run7", "map.toml", "Qualisys"),
        ("export.tsv", "none.toml", "none.toml"),
    ):
        paths = [str(run7.parent / name) for name in (source, "x.mcap", column_map)]
        assert run(["convert", *paths[:2], "--map", paths[2]]) == 2
        assert words in capsys.readouterr().err
    assert not (run7.parent / "x.mcap").exists()


@pytest.mark.parametrize("target", ["elsewhere/run8", "elsewhere/run8.mcap", "elsewhere/run8.csv"])
def test_a_conversion_elsewhere_names_the_same_specimen(target: str, run7: Path, tmp_path: Path) -> None:
    save_specimen(load_specimen("sopra"), tmp_path / "arm.toml")
    (run7 / "recording.toml").write_text('specimen = "../arm.toml"\n')
    (tmp_path / "elsewhere").mkdir()
    assert run(["convert", str(run7), str(tmp_path / target)]) == 0
    converted = load_recording(tmp_path / target)
    assert specimen_of(None, [tmp_path / target], [converted]).name == "sopra"


def test_a_specimen_that_is_named_and_missing_is_refused_with_the_file_that_names_it(run7: Path) -> None:
    table = run7.parent / "run8.csv"
    save_recording(replace(load_recording(run7), info={"specimen": "none.toml"}), table)
    with pytest.raises(InputError, match=r"run8\.toml, specimen: 'none\.toml': no such specimen"):
        specimen_of(None, [table], [load_recording(table)])


def test_convert_says_when_a_file_was_cut_off(run7: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, torn = run7.parent / "x.mcap", run7.parent / "torn.mcap"
    run(["convert", str(run7), str(whole)])
    data = whole.read_bytes()
    torn.write_bytes(data[: data.index(b"softarm.recording") + len(data) * 3 // 4])
    assert run(["convert", str(torn), str(run7.parent / "saved")]) == 0
    assert "cut off" in capsys.readouterr().err
    assert "recovered" in load_recording(run7.parent / "saved").info


def test_wrong_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["convert", str(tmp_path / "no.csv"), "x.mcap"], ["plot", str(tmp_path)]):
        assert run(words) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_plot_draws_every_kind_of_stream(run7: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = run7.parent / "plots"
    assert run(["plot", str(run7), "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == ["paths.png", "spectra.png", "streams.png"]
    assert all(path.read_bytes().startswith(PNG) for path in out.iterdir())
    assert "wrote" in capsys.readouterr().err


def test_a_spectrum_peaks_where_the_arm_swings() -> None:
    time = np.arange(2000) * 0.01
    values = np.sin(2 * np.pi * 2.3 * time)
    values[100:110] = np.nan
    frequencies, density = amplitude_spectrum(time, values)
    assert frequencies[np.argmax(density)] == pytest.approx(2.3, abs=0.1)


def test_streams_that_share_no_times_are_drawn_whole_and_up_to_half_their_own_rate() -> None:
    bend, gauge = np.arange(0.0, 10.0, 0.01), np.arange(0.0033, 10.0, 0.05)
    time = np.union1d(bend, gauge)
    axes = ("bend_tip_x_rad", "bend_tip_y_rad")
    columns = {name: np.full(len(time), np.nan) for name in (*axes, "gauge_tip_n")}
    for name in axes:
        columns[name][np.searchsorted(time, bend)] = 0.1 * np.sin(bend)
    columns["gauge_tip_n"][np.searchsorted(time, gauge)] = np.cos(gauge)
    columns["gauge_tip_n"][(time > 4.0) & (time < 5.0)] = np.nan  # lost, and so a gap
    recording = Recording("live", time, columns, {})
    bends, gauges = draw_streams(recording).axes
    assert all(np.isfinite(line.get_ydata()).all() for line in bends.lines)
    drawn = gauges.lines[0]
    assert np.flatnonzero(np.isnan(drawn.get_ydata())).size == 1
    assert np.isfinite(drawn.get_ydata()).sum() == np.isfinite(columns["gauge_tip_n"]).sum()
    spectra = draw_spectra(recording)
    assert spectra is not None
    assert spectra.axes[0].lines[0].get_xdata().max() == pytest.approx(50.0)
