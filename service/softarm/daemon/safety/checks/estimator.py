"""An estimator that is dead, late or does not converge."""

from collections.abc import Iterator

from softarm.daemon.safety.checks.inputs import FOLLOWING_THE_POSE
from softarm.daemon.safety.diagnostics import Diagnostic, Severity
from softarm.daemon.safety.observation import ServiceHealth
from softarm_client.modes import Mode

FAILURES_ALLOWED = 20
STEERING_BY_THE_ESTIMATE = frozenset({Mode.TEACH, Mode.HOLDING})
"""Modes whose pressures come from the estimate; an experiment plays its own and may excite oscillations."""


def check_estimator(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find an estimator on which the mode can no longer rely."""
    estimator = observation.estimator
    severity: Severity = "fault" if observation.mode in FOLLOWING_THE_POSE else "warning"
    if estimator.starting:
        if severity == "warning":
            return
        message, hint = "the estimator is still being built", "wait until it is ready"
    elif estimator.gave_up:
        message = "the estimator's process died too often; the service does not start it again"
        hint = "see the log for the cause, then restart the service"
    elif not estimator.running:
        message, hint = "the estimator's process is not running", "the service restarts it; see the log"
    elif estimator.age_s is None or estimator.age_s > estimator.deadline_s:
        message, hint = "the estimator returns no results", "a sensor may be lost: see the other findings"
        if observation.busy:
            message = f"{message}, while {observation.busy}"
            hint = "the processor is late: end other programs, or give softarm a core"
    elif estimator.failures > FAILURES_ALLOWED:
        message = f"{estimator.failures} estimates in a row did not converge"
        hint = "the model does not fit the arm: calibrate, or run softarm diagnose on a recording"
        severity = "fault" if observation.mode in STEERING_BY_THE_ESTIMATE else "warning"
    else:
        return
    yield Diagnostic("estimator_failed", "estimator", severity, message, hint)
