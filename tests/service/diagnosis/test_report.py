import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.diagnosis.report import FILE, read_report, report_of
from softarm.cli import run
from softarm.estimator.diagnosis.result import (
    Baseline,
    ChannelError,
    DetectionLimit,
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
    limit = DetectionLimit("tip_payload", Place(section="tip"), "mass", 0.012, "kg")
    told = json.loads(report_of(replace(_diagnosis(), detection_limits=(limit,))).dump())
    assert told["schema"] == "softarm.diagnosis/1"
    assert set(told) == {
        "schema",
        "specimen",
        "recordings",
        "verdict",
        "baseline",
        "findings",
        "heldout",
        "calibration_of_noise",
        "unexplained",
        "detection_limits",
    }
    assert set(told["detection_limits"][0]) == {"effect", "where", "parameter", "size", "unit"}
    assert set(told["baseline"]) == {"rms", "noise_floor", "normalised_rms"}
    assert set(told["heldout"]) == {
        "rms_before",
        "rms_after",
        "rms_linear_regression",
        "pressure_rms_pa",
        "unit",
        "normalised_rms_before",
        "normalised_rms_after",
        "gain_ci95",
        "how_split",
    }
    assert set(told["calibration_of_noise"]) == {
        "white",
        "innovation_variance",
        "innovation_correlation",
        "innovation_chance",
        "residual_variance",
        "residual_correlation",
    }
    assert set(told["unexplained"]) == {"normalised_rms", "where", "when"}
    (finding,) = told["findings"]
    assert finding["where"] == {"segment": None, "chamber": 2, "section": None, "sensor": None, "axis": None}
    assert set(finding["evidence"]) == {
        "log_bayes_factor",
        "heldout_before",
        "heldout_after",
        "heldout_gain_ci95",
    }
    assert finding["confusable_with"][0]["effect"] == "line_leak"
    assert finding["rejected"] == [{"effect": "hysteresis", "log_bayes_factor": 30.0}]
    assert set(finding) == {
        "effect",
        "where",
        "when",
        "statement",
        "parameters",
        "probability",
        "interval",
        "recording",
        "evidence",
        "confusable_with",
        "rejected",
    }
    assert (finding["probability"], finding["interval"], finding["recording"]) == (None, None, None)


def test_held_out_errors_are_in_degrees_and_millimetres_and_those_of_valves_apart() -> None:
    whole = _diagnosis()
    errors = {
        "bend_tip.x": ChannelError("rad", np.pi / 180.0, np.pi / 360.0),
        "marker_tip1.x": ChannelError("m", 0.004, 0.001),
        "pressure_0": ChannelError("Pa", 900.0, 50.0),
    }
    told = report_of(replace(whole, heldout=replace(whole.heldout, channels=errors))).heldout
    assert told.unit == {"bend_tip.x": "deg", "marker_tip1.x": "mm"}
    assert told.rms_before == pytest.approx({"bend_tip.x": 1.0, "marker_tip1.x": 4.0})
    assert told.rms_after == pytest.approx({"bend_tip.x": 0.5, "marker_tip1.x": 1.0})
    assert told.pressure_rms_pa == {"pressure_0": (900.0, 50.0)}


def test_a_probability_lies_between_nought_and_one() -> None:
    whole = _diagnosis()
    for bad in (-0.1, 1.1):
        with pytest.raises(ValueError, match="probability"):
            report_of(replace(whole, findings=(replace(whole.findings[0], probability=bad),)))


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
