"""Which unknowns the data determine, and which manoeuvre would determine the others."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.calibration.parameters import Layout, Parameter

Floats = NDArray[np.float64]
Verdict = Literal["determined", "weakly determined", "kept"]

DETERMINED = 0.5
KEPT = 0.9
MANOEUVRES = {
    "modulus": "hold the arm still at several pressures of its chambers between zero and their limit",
    "gain": "raise this chamber alone in steps up to its limit, each held for 5 s",
    "bias": "hold zero pressure for 10 s, then raise this chamber alone in small steps",
    "curve": "raise single chambers in steps over their whole range, each held for 5 s",
    "bow": "raise single chambers in steps over their whole range, each held for 5 s",
    "crosstalk": "raise each chamber alone up to its limit, and hold random poses, all sections in view",
    "stretch": "pull on the vented arm and on the pressurised one, and hold random poses without",
    "base": "bend each segment by more than 20 degrees in three directions, each held for 5 s",
    "gravity": "hang a known weight, or pull with the gauge in three directions, each held for 5 s",
    "cord": "pull with the gauge by more than 0.2 N in two directions, the hook's marker in view",
    "alignment": "bend the segment by more than 10 degrees in two directions, each held for 5 s",
}


@dataclass(frozen=True)
class Identified:
    """What is known of one unknown after the fit.

    Args:
        parameter: The unknown.
        value: Its value.
        std: Its standard deviation.
        share: That over what was known beforehand.
        verdict: Whether the data determine it.
        manoeuvre: What to record to determine it better; empty where it is determined.
    """

    parameter: Parameter
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
    known = np.sqrt(np.diag(layout.prior_covariance()))
    deviations = np.sqrt(np.diag(covariance))
    return tuple(
        _judge(parameter, float(value), float(std), float(std / spread))
        for parameter, value, std, spread in zip(layout.parameters, values, deviations, known, strict=True)
    )


def _judge(parameter: Parameter, value: float, std: float, share: float) -> Identified:
    verdict: Verdict = "determined"
    if share > KEPT:
        verdict = "kept"
    elif share > DETERMINED:
        verdict = "weakly determined"
    manoeuvre = "" if verdict == "determined" else MANOEUVRES[parameter.kind]
    return Identified(parameter, value, std, share, verdict, manoeuvre)


def fitted(entry: Identified) -> Identified:
    """Count what was fitted as weakly determined at the least: all others rest on its value."""
    return replace(entry, verdict="weakly determined") if entry.verdict == "kept" else entry


def kept(parameter: Parameter) -> Identified:
    """Report an unknown that was settled at what was known beforehand."""
    return Identified(parameter, parameter.mean, parameter.spread, 1.0, "kept", MANOEUVRES[parameter.kind])
