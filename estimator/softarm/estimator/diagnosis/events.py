"""What a diagnosed model makes of the stretches that no steady law of the pressures explained.

The intake compares a recording with a law that the recording itself shows, before anything is known of the
arm: what a wall, a cord or friction do once is no part of that law and looks like a touch. No fit has seen
these stretches. Where the model with all findings predicts them, nothing else acted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.innovations import assumed_std, learnt_coefficients
from softarm.estimator.diagnosis.law_error import SHARE
from softarm.estimator.diagnosis.stage import UNSTABLE, Stage
from softarm.estimator.intake.unsteady import LARGE, least_sizes
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.series import inside

LEAST_SEEN = 0.5
"""Share of an event's samples from which a row, or a model that knows a stable equilibrium, speaks of it."""
TWO_SIDED = 1.96
"""Standard deviations within which 95 % of the errors of a model and of laws lie."""


@dataclass(frozen=True)
class EventErrors:
    """What a model leaves of the events of a recording.

    Args:
        recording: Name of the recording.
        clock: Time of the session's clock [s], shape (samples,).
        errors: Measured minus predicted, NaN outside of events and where no stable equilibrium is known,
            shape (samples, rows).
        stable: Samples at which the model knows a stable equilibrium, shape (samples,).
        allowed: What the model, which yields close to a limit point and vibrates after fast changes of
            pressure, and the laws of the findings may add to them, shape (samples, rows).
        ranges: Range of each row, events included, shape (rows,).
        units: Unit of each row.
    """

    recording: str
    clock: Floats
    errors: Floats
    stable: Flags
    allowed: Floats
    ranges: Floats
    units: tuple[str, ...]

    def explained(self, interval: tuple[float, float]) -> dict[str, float] | None:
        """Return the largest error of a model that predicts an event, in each unit; ``None`` if it does not.

        It does if every error, less what the model and laws may add to it, is below what the intake would
        have reported. A row of which less than half was read, as of a sensor that is stuck, does not count.
        Where most of the time no stable equilibrium is known, an arm may snap through by itself: nothing
        speaks against the model, and there is no error.

        Args:
            interval: From when to when, by the session's clock [s].
        """
        during = inside(self.clock, [interval])
        if self.stable[during].sum() < LEAST_SEEN * during.sum():
            return {}
        errors = np.abs(self.errors[during])
        seen = np.isfinite(errors).sum(axis=0) >= max(LEAST_SEEN * len(errors), 1)
        if not seen.any():
            return None
        errors, units = errors[:, seen], np.array(self.units)[seen]
        beyond = np.maximum(errors - self.allowed[during][:, seen], 0.0)
        least = least_sizes(units.tolist(), self.ranges[seen])
        if (np.nanpercentile(beyond, LARGE, axis=0) > least).any():
            return None
        sizes = np.nanpercentile(errors, LARGE, axis=0)
        return {str(unit): float(sizes[units == unit].max()) for unit in np.unique(units)}


def event_errors(search: Search, fit: Fit | None) -> tuple[EventErrors, ...]:
    """Compute what a model leaves of the events of the recordings in question.

    Args:
        search: The search, whose common coefficients are learnt beside the findings.
        fit: All findings.
    """
    learnt = learnt_coefficients(search, fit)
    found = []
    for stage, columns in zip(search.evidence.stages, search.evidence.columns, strict=True):
        readings = stage.session.event_readings
        if readings is None or stage.session.nominal:
            continue
        change = change_by(stage, fit)
        stable = stage.compliance < UNSTABLE
        errors = stage.innovation(readings) - change - columns @ learnt
        allowed = TWO_SIDED * np.hypot(assumed_std(search, stage), law_errors(stage, fit, change))
        found.append(
            EventErrors(
                stage.session.name,
                stage.session.clock,
                np.where(stable[:, None], errors, np.nan),
                stable,
                allowed,
                _ranges(stage),
                tuple(stage.suite.units),
            )
        )
    return tuple(found)


def law_errors(stage: Stage, fit: Fit | None, change: Floats) -> Floats:
    """Return by how far findings change a stage otherwise if their laws are wrong by their usual share.

    That is ``SHARE`` of what they change, and more where the arm yields far more to a little more of them.

    Args:
        search: The search.
        stage: The stage.
        fit: All findings.
        change: What they change of the predictions.

    Returns:
        In any direction of a sensor, shape (samples, rows).
    """
    errors = SHARE * change_of_sensors(change, stage.suite)
    if fit is None:
        return errors
    for factor in (1.0 - SHARE, 1.0 + SHARE):
        other = change_by(stage, fit.with_amplitudes(factor))
        errors = np.fmax(errors, change_of_sensors(other - change, stage.suite))
    return errors


def change_of_sensors(change: Floats, suite: SensorSuite) -> Floats:
    """Return in each row how far the angles, or the lengths, of its sensor change, shape (samples, rows).

    What a law gets wrong of a change need not point where that does: an arm slips along a wall, and turns
    beside its weak side.

    Args:
        change: Of the predictions, shape (samples, rows).
        suite: The sensors.
    """
    units, sizes = np.array(suite.units), np.zeros_like(change)
    for rows in suite.slices.values():
        for unit in np.unique(units[rows]):
            alike = np.arange(len(units))[rows][units[rows] == unit]
            sizes[:, alike] = np.linalg.norm(change[:, alike], axis=1)[:, None]
    return sizes


def _ranges(stage: Stage) -> Floats:
    """Return the range of each row, events included, shape (rows,); zero where none was read."""
    observed = [row[np.isfinite(row)] for row in stage.with_events.reading_rows.T]
    return np.array([np.ptp(np.percentile(row, [2.0, 98.0])) if len(row) else 0.0 for row in observed])


def errors_of(recording: str, errors: Sequence[EventErrors]) -> EventErrors | None:
    """Return the errors of a recording, where it had events that the model was asked for."""
    return next((one for one in errors if one.recording == recording), None)
