"""Arms that are not SoPrA, from a recording of their fake to calibration, estimate and diagnosis."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner

from softarm.cli import run
from softarm.estimator.specimen import Specimen, load_specimen, save_specimen
from softarm.fakes.plant.__main__ import main as fake_arm
from tests.sim_fakes.arms import of_a_mesh_file, three_chambers

HIGHEST_PA = 30e3
TRIP_S = 4.0


def cylinder(folder: Path) -> Specimen:
    save_specimen(three_chambers(), folder / "arm.toml")
    return load_specimen(folder / "arm.toml")


SHAPES: dict[str, Callable[[Path], Specimen]] = {"cylinder": cylinder, "mesh file": of_a_mesh_file}


@pytest.fixture(params=SHAPES)
def folder(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with ``arm.toml``, which is worked in."""
    SHAPES[request.param](tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(folder: Path, name: str, trips: int) -> None:
    """Record the fake arm going to random pressures and resting there."""
    levels = np.random.default_rng(trips).uniform(0.0, HIGHEST_PA, (trips, 3))
    levels[0] = 0.0
    start = TRIP_S * np.arange(trips)
    times = np.column_stack([start, start + 0.7 * TRIP_S]).ravel()
    columns = {f"pressure_cmd_{k}_pa": np.repeat(levels[:, k], 2) for k in range(3)}
    pl.DataFrame({"t_s": times, **columns}).write_csv(folder / f"{name}.csv")
    words = ["record", name, "--specimen", "arm.toml", "--commands", f"{name}.csv"]
    made = CliRunner().invoke(fake_arm, words)
    assert made.exit_code == 0, made.output


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    capsys.readouterr()
    assert run([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


def test_the_estimate_follows_the_fake_of_an_own_arm(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(folder, "short", trips=2)
    words = ("--specimen", "arm.toml", "--rate", "0.5", "--out", "estimate.csv")
    *_, residuals = printed(capsys, "estimate", "short", *words)["tables"]
    units = [(row["sensor"], row["unit"]) for row in residuals["rows"]]
    assert units == [("bend_tip", "degrees"), ("frame_tip", "mm"), ("frame_tip", "degrees")]
    estimates = pl.read_csv(folder / "estimate.csv")
    assert len(estimates) >= 3
    assert estimates["estimate_force_tip_x_n"].null_count() == 0
    assert (estimates["estimate_force_tip_x_std_n"] > 0.0).all()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_an_own_arm_is_calibrated_estimated_and_diagnosed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(folder, "fitted", trips=15)
    record(folder, "later", trips=8)
    calibrated = printed(
        capsys, "calibrate", "fitted", "--specimen", "arm.toml", "--out", "mine.toml", "--nodes", "48"
    )
    assert "held out" in json.dumps(calibrated).replace("_", " ")
    mine = load_specimen(folder / "mine.toml")
    assert 0.3 < mine.calibration.modulus_scale["upper"].value < 3.0
    printed(capsys, "estimate", "later", "--specimen", "mine.toml", "--rate", "1", "--out", "estimate.csv")
    estimates = pl.read_csv(folder / "estimate.csv")
    assert np.abs(estimates["estimate_force_tip_x_n"]).median() < 0.3  # nothing pulls
    report = printed(
        capsys, "diagnose", "later", "--nominal", "fitted", "--specimen", "mine.toml", "--out", "report"
    )
    assert report["verdict"] == "consistent"
