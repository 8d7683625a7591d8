"""Which unknowns the data determine, and which manoeuvre would determine the others."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.layout import Layout
from softarm.estimator.calibration.unknowns import Unknown

Verdict = Literal["determined", "weakly determined", "kept"]

# Deviation over that before any data: up to here an unknown is determined, beyond the next it is not fitted.
DETERMINED = 0.5
KEPT = 0.9


@dataclass(frozen=True)
class Identified:
    """The estimate of one unknown after the fit.

    Args:
        std: Its standard deviation.
        share: That over the deviation of its prior.
        verdict: Whether the data determine it.
        manoeuvre: What to record to determine it better; empty where it is determined.
    """

    unknown: Unknown
    value: float
    std: float
    share: float
    verdict: Verdict
    manoeuvre: str


def identify(layout: Layout, values: Floats, covariance: Floats) -> tuple[Identified, ...]:
    """Judge every unknown by how far the data have narrowed it.

    Args:
        layout: The unknowns.
        values: Their values, shape (unknowns,).
        covariance: Their covariance, shape (unknowns, unknowns).
    """
    prior_std = np.sqrt(np.diag(layout.prior_covariance()))
    deviations = np.sqrt(np.diag(covariance))
    return tuple(
        _judge(unknown, float(value), float(std), float(std / spread))
        for unknown, value, std, spread in zip(layout.unknowns, values, deviations, prior_std, strict=True)
    )


def _judge(unknown: Unknown, value: float, std: float, share: float) -> Identified:
    verdict: Verdict = "determined"
    if share > KEPT:
        verdict = "kept"
    elif share > DETERMINED:
        verdict = "weakly determined"
    manoeuvre = "" if verdict == "determined" else unknown.manoeuvre
    return Identified(unknown, value, std, share, verdict, manoeuvre)


def fitted(entry: Identified) -> Identified:
    """Count what was fitted as weakly determined at the least: all others rest on its value."""
    return replace(entry, verdict="weakly determined") if entry.verdict == "kept" else entry


def kept(unknown: Unknown) -> Identified:
    """Report an unknown that was settled at its prior."""
    return Identified(unknown, unknown.mean, unknown.spread, 1.0, "kept", unknown.manoeuvre)
