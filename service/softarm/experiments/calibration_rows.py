"""Rows of the calibration experiment: what was found, the paper's two beside ours, and the drift check."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from softarm.estimator.calibration import Calibrated, CalibrationRun, check_drift
from softarm.estimator.calibration.nodes import choose_nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.unknowns import Modulus
from softarm.estimator.response import BatchArmModel
from softarm.estimator.specimen import Specimen
from softarm.experiments.figures import Cells
from softarm.experiments.paper_calibration import calibrate_as_paper
from softarm.experiments.validation import pose_errors

Runs = Callable[[str, Specimen], CalibrationRun]
Models = Callable[[Specimen], BatchArmModel]
SAMPLES = 6


def unknown_rows(outcome: Calibrated) -> list[Cells]:
    """List every unknown with its deviation, verdict and the manoeuvre that is missing."""
    return [
        {
            "unknown": entry.unknown.name,
            "value": float(np.exp(entry.value)) if isinstance(entry.unknown, Modulus) else entry.value,
            "std": entry.std,
            "unit": "factor" if isinstance(entry.unknown, Modulus) else entry.unknown.unit,
            "std_over_known_before": entry.share,
            "verdict": entry.verdict,
            "manoeuvre": entry.manoeuvre,
        }
        for entry in outcome.identified
    ]


def comparison_rows(nominal: Specimen, joint: Specimen, runs: Runs, models: Models) -> list[Cells]:
    """Predict held-out poses and pulls with the paper's two calibrations and the joint one."""
    solver = models(nominal)
    paper = calibrate_as_paper(solver, nominal, runs("sweep", nominal), runs("pulls", nominal))
    cases = (
        ("paper's first (pressures)", paper.shape, paper.alpha_shape.value),
        ("paper's second (force)", paper.force, paper.alpha_force.value),
        ("joint", joint, None),
    )
    rows: list[Cells] = []
    for name, specimen, alpha in cases:
        model = models(specimen)
        row: Cells = {"calibration": name, "alpha": alpha}
        for what, run in (("random poses", "validation"), ("pulls", "force_still")):
            holds = sampled(runs(run, specimen), SAMPLES, pulled=run == "force_still")
            last = pose_errors(model, specimen, holds)[-1]
            word = what.replace(" ", "_")
            row[f"{word}_mean_mm"] = float(np.nanmean(last.millimetres))
            row[f"{word}_mean_degrees"] = float(np.nanmean(last.degrees))
        rows.append(row)
    return rows


def drift_rows(specimen: Specimen, runs: Runs, models: Models) -> list[Cells]:
    """Check the calibration against later recordings of the same arm."""
    check = check_drift(models(specimen), specimen, [runs("validation", specimen)], nodes=16)
    return [
        {
            "quantity": drift.quantity,
            "scatter_now": drift.scatter,
            "scatter_calibrated": drift.calibrated,
            "ratio": drift.ratio,
            "stale": drift.stale,
        }
        for drift in check
    ]


def sampled(run: CalibrationRun, count: int, *, pulled: bool = False) -> CalibrationRun:
    """Average a run over short windows, evenly spread.

    Args:
        run: What was recorded.
        count: Number of windows.
        pulled: Keep only those at which a known force acts.
    """
    nodes = choose_nodes(run, 4 * count if pulled else count)
    members = np.arange(len(nodes.time))
    if pulled:
        members = np.flatnonzero((np.abs(nodes.loads) > LEAST_PULL).any(axis=1))
    picked = members[np.unique(np.linspace(0, len(members) - 1, count).astype(int))] if len(members) else []
    at = np.isin(np.arange(len(nodes.time)), picked)
    return replace(
        run,
        time=nodes.time[at],
        pressures=nodes.pressures[at],
        readings=nodes.readings[at],
        loads=nodes.loads[at],
    )
