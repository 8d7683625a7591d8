"""Readings as a linear function of pressures, with no model, and the lag between their clocks."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.arrange import CalibrationRun

LONGEST_LAG = 0.3  # s
LAG_STEP = 0.02
FEWEST_SAMPLES = 100


@dataclass(frozen=True)
class Line:
    """Ordinary linear regression of readings on pressures.

    Args:
        slopes: Shape (chambers + 1, readings); the last row is the offset.
    """

    slopes: Floats

    @property
    def parameters(self) -> int:
        """Number of fitted numbers."""
        return int(self.slopes.size)

    def predict(self, pressures: Floats) -> Floats:
        """Return the readings for pressures [Pa], shape (samples, chambers)."""
        predicted: Floats = _columns(pressures) @ self.slopes
        return predicted


def fit_line(pressures: Floats, readings: Floats) -> Line:
    """Fit each reading by least squares, samples in which it was lost left out.

    Args:
        pressures: [Pa], shape (samples, chambers).
        readings: Shape (samples, readings).
    """
    present, columns = np.isfinite(pressures).all(axis=1), _columns(pressures)
    slopes = np.full((columns.shape[1], readings.shape[1]), np.nan)
    for values, slope in zip(readings.T, slopes.T, strict=True):
        observed = present & np.isfinite(values)
        if observed.any():
            slope[:], *_ = np.linalg.lstsq(columns[observed], values[observed], rcond=None)
    return Line(slopes)


def estimate_lag(run: CalibrationRun) -> float | None:
    """Estimate how far the motion lags behind the pressures [s]; None where too little moves.

    The lag of the clocks and that of the arm's own inertia add up; a static model needs both removed.
    """
    moving = np.isfinite(run.readings).any(axis=1) & np.isfinite(run.pressures).all(axis=1)
    if moving.sum() < FEWEST_SAMPLES or not (np.nanstd(run.pressures, axis=0) > 0).any():
        return None
    lags = np.arange(-LONGEST_LAG, LONGEST_LAG + LAG_STEP / 2, LAG_STEP)
    unexplained = np.array([_unexplained(run.delayed(lag)) for lag in lags])
    # Where pressures explain less than half of the motion, the best lag is a matter of chance.
    if unexplained.min() > 0.5:
        return None
    return _lowest(lags, unexplained)


def _unexplained(run: CalibrationRun) -> float:
    """Return the share of the readings' variance that a line leaves, each reading over its own."""
    shares = []
    residuals = run.readings - fit_line(run.pressures, run.readings).predict(run.pressures)
    for values, residual in zip(run.readings.T, residuals.T, strict=True):
        observed = np.isfinite(residual)
        if observed.any() and (variance := values[observed].var()) > 0.0:
            shares.append(residual[observed].var() / variance)
    return float(np.mean(shares)) if shares else 1.0


def _lowest(lags: Floats, unexplained: Floats) -> float:
    """Find the minimum of a parabola through the lowest point and its neighbours."""
    at = int(np.argmin(unexplained))
    if at in (0, len(lags) - 1):
        return float(lags[at])
    before, here, after = unexplained[at - 1 : at + 2]
    curvature = before - 2.0 * here + after
    shift = 0.5 * (before - after) / curvature if curvature > 0 else 0.0
    return float(lags[at] + shift * (lags[1] - lags[0]))


def _columns(pressures: Floats) -> Floats:
    return np.column_stack([pressures, np.ones(len(pressures))])
