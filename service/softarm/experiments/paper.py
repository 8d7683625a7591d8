"""What the paper printed, and what is aimed at: one row per experiment."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """Errors of one experiment in Cangan et al., with the aim set against them.

    Args:
        mean: Mean error in the experiment's unit.
        largest: Largest error.
        aim: Mean error aimed at.
        span: Range of the measured quantity; NaN where errors are not stated in percent of it.
    """

    mean: float
    largest: float
    aim: float
    span: float = float("nan")


VALIDATION_MM = Published(36.5, 59.3, 4.0)
VALIDATION_DEGREES = Published(13.7, 26.5, 2.0)
TEACH_MM = Published(5.2, 13.5, 2.0)
TEACH_DEGREES = Published(4.0, 11.4, 1.5)
FORCE_N = {
    "not pressurised": Published(0.007, 0.059, 0.005 * 0.667, 0.667),
    "pressurised": Published(0.0238, 0.177, 0.006 * 1.98, 1.98),
}
"""Against the gauge, by condition."""
