"""The offline commands on recordings of a beam of known stiffness, with a known weight, made by the model."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softarm.analysis.offline.track import STATUSES, Track
from softarm.cli import estimate, run
from softarm.estimator.arm import build_arm
from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.model import Inputs
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen, load_specimen, save_specimen
from softarm.recordings import load_recording, save_recording

SCALE = 1.3
WEIGHT = -0.3  # N along x, which points up
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SHIFT = np.array([0.2, -0.1, 0.05])


@pytest.fixture(scope="module")
def beam() -> Specimen:
    return load_specimen("beam")


def record(beam: Specimen, scale: float, weight: float, folder: Path, seconds: float = 1.5) -> Path:
    model = build_arm(beam).with_scales({"upper": scale})
    inputs = Inputs(np.zeros(0), np.array([weight, 0.0]), np.array(beam.gravity_m_s2))
    state, found = model.solve(inputs, model.rest())
    assert found
    frames = model.section_frames(state)
    rng = np.random.default_rng(0)
    time = np.arange(0, seconds, 0.02)
    columns = {}
    for marker in beam.markers:
        section = model.sections.index(marker.section)
        place = frames.positions[section] + frames.rotations[section] @ np.array(marker.offset_m)
        noisy = TURN @ place + SHIFT + rng.normal(0, 1e-4, (len(time), 3))
        columns |= {f"marker_{marker.name}_{a}_m": noisy[:, i] for i, a in enumerate("xyz")}
    recording = Recording(folder.name, time, columns, {"specimen": "beam", "rate_hz": 50.0})
    save_recording(recording, folder)
    return folder


@pytest.fixture(scope="module")
def loaded(beam: Specimen, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(beam, SCALE, WEIGHT, tmp_path_factory.mktemp("runs") / "loaded")


@pytest.fixture(scope="module")
def bare(beam: Specimen, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(beam, SCALE, 0.0, tmp_path_factory.mktemp("runs") / "bare")


def test_calibration_finds_the_modulus_and_then_the_estimate_finds_the_weight(
    bare: Path, loaded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    specimen = tmp_path / "mine.toml"
    assert run(["calibrate", str(bare), "--out", str(specimen), "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert tables[0]["rows"][0]["unknown"] == "modulus.upper"
    modulus = tables[0]["rows"][0]
    assert abs(modulus["value"] - np.log(SCALE)) < 3 * modulus["std"] < 0.2

    out = tmp_path / "estimate.mcap"
    words = ["estimate", str(loaded), "--specimen", str(specimen), "--rate", "5", "--out", str(out)]
    assert run([*words, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)["tables"]
    forces = {row["load"]: row for row in printed[0]["rows"]}
    assert forces["tip_x"]["mean"] == pytest.approx(WEIGHT, abs=0.02)
    assert abs(forces["tip_x"]["mean"] - WEIGHT) < 3 * forces["tip_x"]["std_of_estimate"]
    assert forces["tip_y"]["mean"] == pytest.approx(0.0, abs=0.02)

    estimate = load_recording(out)
    assert estimate.columns["estimate_force_tip_x_n"].mean() == pytest.approx(forces["tip_x"]["mean"])
    assert (estimate.columns["estimate_status"] == 0).all()
    assert estimate.markers == load_recording(loaded).markers
    names = ["arm.png", "forces.png", "residuals.png", "sections.png"]
    assert sorted(path.name for path in (tmp_path / "plots" / load_recording(loaded).name).iterdir()) == names


def test_the_old_specimen_is_never_replaced_unasked(
    bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text("keep me")
    assert run(["calibrate", str(bare), "--out", str(tmp_path / "mine.toml")]) == 2
    assert (tmp_path / "mine.toml").read_text() == "keep me"
    assert "exists already" in capsys.readouterr().err


def test_a_refused_fit_keeps_the_old_specimen(
    beam: Specimen, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = tmp_path / "mine.toml"
    save_specimen(beam, old)
    before = old.read_bytes()
    runs = [
        str(record(beam, scale, 0.0, tmp_path / name)) for scale, name in ((2.0, "stiff"), (1.0, "plain"))
    ]
    assert run(["calibrate", *runs, "--specimen", str(old), "--out", str(old), "--force"]) == 1
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert "predicted worse than before" in told
    assert "the old calibration stays" in told
    assert old.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--specimen", "bean"], "did you mean 'beam'"),
        (["--specimen", "sopra"], "was recorded on 'beam', not on 'sopra'"),
        (["--window", "9", "7"], "--window: 9 s is not before 7 s; give the earlier time first"),
        (["--window", "7", "9"], "has no samples between 7 and 9 s; it lasts from 0 to 1.48 s"),
        (["--rate", "0"], "0.0 is not in the range"),
    ],
)
def test_wrong_use_is_one_line(
    words: list[str], message: str, bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["estimate", str(bare), "--plots", str(tmp_path / "plots"), *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_recording_that_names_no_specimen(
    bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = load_recording(bare)
    save_recording(Recording("x", recording.time, recording.columns), tmp_path / "x.csv")
    assert run(["estimate", str(tmp_path / "x.csv")]) == 2
    assert "give it with --specimen" in capsys.readouterr().err


EXAMPLE = Path(__file__).parents[2] / "examples" / "recordings" / "sopra_pull"


def test_the_shipped_recording_tells_the_pull_at_its_tip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["estimate", str(EXAMPLE), "--window", "2", "2.8", "--rate", "5", "--plots", str(tmp_path)]
    assert run([*words, "--json"]) == 0
    rows = {row["load"]: row for row in json.loads(capsys.readouterr().out)["tables"][0]["rows"]}
    assert rows["tip_x"]["mean"] == pytest.approx(0.3, abs=0.015)
    assert rows["tip_y"]["mean"] == pytest.approx(0.0, abs=0.015)
    assert (tmp_path / "arm.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["estimates.xlsx", "there"])
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    save_recording(load_recording(bare), tmp_path / "there")
    assert (
        run(["estimate", str(bare), "--out", str(tmp_path / name), "--plots", str(tmp_path / "plots")]) == 2
    )
    said = capsys.readouterr()
    assert name in said.err
    assert not said.out
    assert not (tmp_path / "plots").exists()


def test_a_run_on_which_no_search_converges_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    estimated = estimate._on_rod

    def lost(robot: Specimen, run: CalibrationRun) -> tuple[Track[Any], Callable[[Any], Floats]]:
        found, surface = estimated(robot, run)
        return replace(found, status=np.full(len(run.time), STATUSES.index("diverged"))), surface

    monkeypatch.setattr(estimate, "_on_rod", lost)
    out = tmp_path / "out.csv"
    words = [
        "estimate",
        str(EXAMPLE),
        "--window",
        "2",
        "2.8",
        "--rate",
        "5",
        "--plots",
        str(tmp_path / "plots"),
    ]
    assert run([*words, "--out", str(out)]) == 1
    assert "no search converged with calibrated rod" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
