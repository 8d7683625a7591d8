"""What ``softarm diagnose`` makes of real recordings, as tables of ``softarm bench real-data``."""

import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from scipy import constants

from softarm.analysis.diagnosis.report import FindingPart, Report, read_report
from softarm.analysis.offline.inputs import cut, load_recordings
from softarm.common.tables import Cell, Table
from softarm.estimator.effects.effect import describe
from softarm.recordings.load import save_recording

ARM, VALVES = "sopra_2021-07-09", "sopra_valve_steps_0-2"
BARE, LOADED = "beam_gravity_v2_a", "beam_load52_v2_a"


def diagnosed(*words: str | Path) -> Report:
    """Run ``softarm diagnose`` with some arguments and read its report."""
    with TemporaryDirectory() as scratch:
        out = Path(scratch) / "report"
        command = [sys.executable, "-m", "softarm", "diagnose", *map(str, words), "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        return read_report(out)


def arm_diagnoses(folder: Path, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Diagnose the arm from its whole recording and from each half alone."""
    (recording,) = load_recordings([folder / ARM])
    start, end = float(recording.time[0]), float(recording.time[-1])
    windows = {
        "whole": (start, end),
        "first half": (start, 0.5 * (start + end)),
        "second half": (0.5 * (start + end), end),
    }
    reports = {}
    with TemporaryDirectory() as scratch:
        for name, window in windows.items():
            path = Path(scratch) / name.replace(" ", "_")
            save_recording(cut(recording, window), path)
            reports[name] = diagnosed(path, "--specimen", "sopra")
            advance(0.3)
    return (
        Table(
            "sopra_2021-07-09: error on data that softarm diagnose has not seen [degrees]",
            [row for name, report in reports.items() for row in _error_rows(name, report)],
            (
                "Line: ordinary linear regression of six pressures (and an offset) to each angle, on the "
                "data that the diagnosis fits.",
                "Innovations: variance of what the past does not predict, by the law that others show (1 "
                "expected), and correlation of neighbours (0 expected). Residuals: their variance over that "
                "which the diagnosis assumed (1 expected).",
            ),
        ),
        Table(
            "sopra_2021-07-09: what softarm diagnose finds",
            [row for name, report in reports.items() for row in _finding_rows(name, report)],
        ),
    )


def _error_rows(name: str, report: Report) -> list[dict[str, Cell]]:
    heldout, noise = report.heldout, report.calibration_of_noise
    return [
        {
            "recording": name,
            "angle": channel,
            "line": line,
            "model": heldout.rms_after[channel],
            "line_over_model": line / heldout.rms_after[channel],
            "innovations": noise.innovation_variance.get(channel),
            "correlation": noise.innovation_correlation.get(channel),
            "residuals": noise.residual_variance.get(channel),
        }
        for channel, line in heldout.rms_linear_regression.items()
    ]


def _finding_rows(name: str, report: Report) -> list[dict[str, Cell]]:
    return [
        {
            "recording": name,
            "finding": finding.effect,
            "where": describe(finding.where),
            "probability": finding.probability,
            "not_distinguished_from": ", ".join(one.effect for one in finding.confusable_with),
        }
        for finding in report.findings
    ]


def diagnosed_valves(folder: Path) -> Table:
    """Diagnose the valve bank alone, which raises three chambers in turn."""
    report = diagnosed(folder / VALVES, "--specimen", "sopra")
    return Table(
        f"{VALVES}: what softarm diagnose finds",
        _parameter_rows(report.findings, lambda finding: {"chamber": finding.where.chamber}),
        (
            "Known of them: a dead time of 0.04 to 0.06 s, a steady error of -500 to -900 Pa, an overshoot, "
            "and the ripple of an arm that swings.",
        ),
    )


def diagnosed_beam(folder: Path) -> Table:
    """Diagnose the loaded beam, the bare one being its known state."""
    report = diagnosed(folder / LOADED, "--nominal", folder / BARE, "--specimen", "beam")
    return Table(
        "Silicone beam: what softarm diagnose finds, told nothing of the weight",
        _parameter_rows(report.findings, lambda finding: {"section": finding.where.section or ""}),
        (f"What hangs there: {weight(folder / LOADED) / constants.g:.4g} kg.",),
    )


def _parameter_rows(
    findings: Sequence[FindingPart], place: Callable[[FindingPart], dict[str, Cell]]
) -> list[dict[str, Cell]]:
    """List the parameters of findings."""
    return [
        {"finding": finding.effect}
        | place(finding)
        | {
            "quantity": name,
            "value": parameter.value,
            "std": parameter.std,
            "unit": parameter.unit,
            "probability": finding.probability,
        }
        for finding in findings
        for name, parameter in finding.parameters.items()
    ]


def weight(folder: Path) -> float:
    """Read the weight that is known to hang at the tip [N]."""
    return float(tomllib.loads((folder / "truth.toml").read_text())["tip_load_n"])
