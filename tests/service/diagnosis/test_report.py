import json
from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.diagnosis.report import FILE, read_report, report_of
from softarm.cli import run
from softarm.estimator.diagnosis.result import (
    Baseline,
    Diagnosis,
    Evidence,
    Finding,
    Heldout,
    LocationMap,
    Quantity,
    Rejected,
    Rival,
    Unexplained,
)
from softarm.estimator.errors import InputError
from softarm.estimator.specimen.physics import Place


def _diagnosis() -> Diagnosis:
    finding = Finding(
        "chamber_gain",
        Place(chamber=2),
        "pressure level",
        "Chamber 2 acts too weakly.",
        {"gain": Quantity(-0.1, 0.01, "1")},
        Evidence(40.0, 2.0, 1.1, (0.3, 0.5), 0.0),
        (Rival("line_leak", Place(chamber=2), "close the valve", 3.0),),
        (Rejected("hysteresis", Place(), 30.0),),
    )
    return Diagnosis(
        "sopra",
        ("run",),
        (),
        "explained",
        Baseline({"bend_tip.x": 0.02}, {"bend_tip.x": 0.01}, {"bend_tip.x": "rad"}, 2.0),
        LocationMap(),
        (finding,),
        Heldout(2.0, 1.1, (0.3, 0.5), "whole recordings"),
        Unexplained(1.0),
    )


def test_a_report_reads_back_as_it_was_written(tmp_path: Path) -> None:
    report = report_of(_diagnosis())
    (tmp_path / FILE).write_text(report.dump())
    assert read_report(tmp_path) == report


def test_a_report_holds_what_the_contract_lists() -> None:
    told = json.loads(report_of(_diagnosis()).dump())
    assert told["schema"] == "softarm.diagnosis/1"
    assert set(told) == {
        "schema",
        "specimen",
        "recordings",
        "verdict",
        "baseline",
        "findings",
        "heldout",
        "unexplained",
    }
    (finding,) = told["findings"]
    assert finding["where"] == {"segment": None, "chamber": 2, "section": None, "sensor": None, "axis": None}
    assert set(finding["evidence"]) == {
        "delta_bic",
        "heldout_before",
        "heldout_after",
        "heldout_gain_ci95",
    }
    assert finding["confusable_with"][0]["effect"] == "line_leak"


def test_a_number_that_is_none_is_refused() -> None:
    broken = _diagnosis()
    with pytest.raises(ValueError, match="finite"):
        report_of(Diagnosis(**{**vars(broken), "heldout": Heldout(np.nan, 1.0, (0.0, 0.0), "")}))


def test_a_broken_report_is_named_with_its_field(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text('{"schema": "softarm.diagnosis/1", "specimen": 3}')
    with pytest.raises(InputError, match="specimen"):
        read_report(tmp_path)
    with pytest.raises(InputError, match="there is no such report"):
        read_report(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere", "--specimen", "sopra"], "nowhere"),
        (["--nominal", "a", "b", "--specimen", "sopra"], "RECORDING"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["diagnose", *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_a_still_recording_is_refused_with_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(0.0, 30.0, 0.05)
    rows = "\n".join(f"{t:.2f},0,0.1,0.1" for t in time)
    (tmp_path / "recording.csv").write_text(f"t_s,pressure_0_pa,bend_tip_x_rad,bend_tip_y_rad\n{rows}\n")
    assert run(["diagnose", str(tmp_path), "--specimen", "sopra"]) == 2
    told = capsys.readouterr().err
    assert "nothing moves" in told
    assert "record at least 20 s" in told
    assert told.count("\n") == 1
