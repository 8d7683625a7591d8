"""The paper's two calibrations, for comparison: pressures against orientation, then force against the gauge.

First: one factor alpha on the modulus of both segments and six gains nu_1..6 with mean 1, fitted to
orientations while each chamber is filled alone. Second: another factor alone, fitted to orientations while
the gauge pulls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.fit import CalibrationFit, fit
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import Layout, build_layout
from softarm.estimator.calibration.nodes import Nodes, choose_nodes
from softarm.estimator.calibration.unknowns import Gain, Modulus
from softarm.estimator.errors import InputError
from softarm.estimator.response import BatchArmModel
from softarm.estimator.specimen import ChamberCalibration, Specimen, Value
from softarm.experiments.subsets import subset

TIED = 1e-3
LEAST_SPREAD_PA = 1e3
NODES = 10
"""Samples of each fit."""


@dataclass(frozen=True)
class PaperCalibration:
    """The result of the paper's procedure.

    Args:
        shape: Specimen after the first calibration.
        force: Specimen after the second: other moduli, the same gains.
        alpha_shape: Factor on the moduli of the first, with its deviation.
        alpha_force: Of the second.
    """

    shape: Specimen
    force: Specimen
    alpha_shape: Value
    alpha_force: Value


def calibrate_as_paper(
    model: BatchArmModel, specimen: Specimen, sweep: CalibrationRun, pulls: CalibrationRun
) -> PaperCalibration:
    """Calibrate twice, as the paper does.

    Args:
        model: Model of the specimen with ``section_forces``.
        specimen: The robot, uncalibrated.
        sweep: Each chamber filled alone.
        pulls: The gauge pulls, the arm vented.

    Raises:
        InputError: The sweep does not move every chamber.
    """
    moved = np.ptp(np.nan_to_num(sweep.pressures), axis=0)
    if (moved < LEAST_SPREAD_PA).any():
        missing = ", ".join(str(k) for k in np.flatnonzero(moved < LEAST_SPREAD_PA))
        raise InputError(
            sweep.name, f"chamber {missing} is never filled", "fill each chamber alone, from 0 to 65 kPa"
        )
    first = _fit(model, specimen, [subset(sweep, "orientations")], with_gains=True)
    names = _names(specimen, with_gains=True)
    scales = {s.name: np.exp(first.values[names.index(f"modulus.{s.name}")]) for s in specimen.segments}
    gains = tuple(float(first.values[names.index(f"gain.{c.index}")]) for c in specimen.chambers)
    alpha = _alpha(first, scales)
    shape = _written(specimen, alpha, gains)
    second = _fit(model, shape, [subset(pulls, "orientations")], with_gains=False)
    after = {s.name: float(np.exp(v)) for s, v in zip(specimen.segments, second.values, strict=True)}
    alpha_force = _alpha(second, after)
    return PaperCalibration(shape, _written(specimen, alpha_force, gains), alpha, alpha_force)


def _fit(
    model: BatchArmModel, specimen: Specimen, runs: Sequence[CalibrationRun], *, with_gains: bool
) -> CalibrationFit:
    chosen: tuple[Nodes, ...] = tuple(choose_nodes(run, NODES) for run in runs)
    layout = _layout(specimen, runs[0], model, _names(specimen, with_gains=with_gains))
    forward = Forward(model, layout, chosen)
    return fit(forward, layout.means, iterations=5)


def _names(specimen: Specimen, *, with_gains: bool) -> list[str]:
    gains = [f"gain.{chamber.index}" for chamber in specimen.chambers] if with_gains else []
    return [f"modulus.{segment.name}" for segment in specimen.segments] + gains


def _layout(specimen: Specimen, run: CalibrationRun, model: BatchArmModel, names: list[str]) -> Layout:
    """Tie the moduli together and the mean gain to one."""
    chambers = [chamber.index for chamber in specimen.chambers]
    whole = build_layout(specimen, run.suite, run.pressure_source, chambers, model.regions)
    layout = whole.without([name for name in whole.names if name not in names])
    count = len(layout.unknowns)
    moduli = layout.of(Modulus)
    gains = layout.of(Gain).astype(float)
    rows, means = [], []
    for index in np.flatnonzero(moduli)[1:]:
        row = np.zeros(count)
        row[[0, index]] = 1.0, -1.0
        rows.append(row)
        means.append(0.0)
    if gains.any():
        rows.append(gains / gains.sum())
        means.append(1.0)
    return replace(
        layout,
        combinations=np.array(rows).reshape(-1, count),
        combination_means=np.array(means),
        combination_spreads=np.full(len(rows), TIED),
    )


def _alpha(fitted: CalibrationFit, scales: dict[str, float]) -> Value:
    factor = float(np.mean(list(scales.values())))
    return Value(value=factor, std=factor * float(np.sqrt(fitted.covariance[0, 0])))


def _written(specimen: Specimen, alpha: Value, gains: Sequence[float]) -> Specimen:
    calibration = specimen.calibration.model_copy(
        update={
            "modulus_scale": {segment.name: alpha for segment in specimen.segments},
            "chambers": tuple(
                ChamberCalibration(index=chamber.index, gain=Value(value=gain))
                for chamber, gain in zip(specimen.chambers, gains, strict=True)
            ),
        }
    )
    return specimen.model_copy(update={"calibration": calibration})
