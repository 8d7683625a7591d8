"""A calibrated rod that is off the finite elements it was fitted to."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import ServiceHealth

ALLOWED_DEGREES = 0.5


def check_rod(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a rod that its last comparison showed to be off."""
    off = observation.estimator.rod_off_degrees
    if off is not None and off > ALLOWED_DEGREES:
        message = f"the calibrated rod is {off:.2g} degrees away from the finite elements"
        hint = 'the arm is outside the range in which the rod was fitted: set control.model = "fem"'
        yield Diagnostic("rod_off", "estimator", "warning", message, hint)
