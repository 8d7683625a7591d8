"""Touches in what a diagnosed model leaves of the recordings.

The intake knows of an arm what one recording shows of it. Where no two poses are alike that is little, and a
hand that moves the arm for some seconds is hardly larger than what the law of the recording gets wrong. A
model with all findings errs far less, and what it leaves follows a law of the pressures as well.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.innovations import residuals_as_known
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.intake import Disturbance
from softarm.estimator.intake.disturbances import Watched, disturbances, tip_lever
from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.provoked import slopes_of
from softarm.estimator.intake.streams import moving_columns
from softarm.estimator.intake.unsteady import (
    LEAST,
    SHORTEST,
    law_errors,
    least_sizes,
    ranges_of,
    window_of,
)
from softarm.estimator.sensing import Bend
from softarm.estimator.series import inside
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import MAD_TO_STD

SIZES = (1.0, 3.0, 10.0)
"""Standard deviations of a touch over the least that moves a fit, equally probable: 2 to 20 degrees."""
SEEN = 0.5
"""Share of a recording from which a channel speaks of it."""


def find_touches(search: Search, fit: Fit | None, specimen: Specimen) -> tuple[Disturbance, ...]:
    """Find the stretches of which a model with all findings leaves what no steady law explains.

    Args:
        search: The search, whose common coefficients are learnt beside the findings.
        fit: All findings.
        specimen: The robot, whose lengths convert bends into displacements.

    Returns:
        What was found, by the clock of the sessions.
    """
    return tuple(
        touch
        for stage, residual in zip(search.evidence.stages, residuals_as_known(search, fit), strict=True)
        for touch in touches_of(stage, out_of_reach(stage, fit, residual), specimen)
    )


def out_of_reach(stage: Stage, fit: Fit | None, residual: Floats) -> Floats:
    """Return a residual without the samples at which walls and cords that were found act on the arm.

    What the model gets wrong of them comes and goes as a hand does. Nominal recordings have none of them.
    """
    if stage.session.nominal:
        return residual
    least = np.array([LEAST[unit] for unit in stage.suite.units])
    reached = np.any(contact_change(stage, fit) > least, axis=1)
    return np.where(reached.reshape(-1, 1), np.nan, residual)


def contact_change(stage: Stage, fit: Fit | None) -> Floats:
    """Return by how much walls and cords that were found change the predictions, shape (samples, rows)."""
    acting = [k for k, h in enumerate(fit.hypotheses) if h.effect.responds_to_own_effect] if fit else []
    if fit is None or not acting:
        return np.zeros(stage.residual.shape)
    return np.abs(change_by(stage, fit.selected(acting)))


def touches_of(stage: Stage, residual: Floats, specimen: Specimen) -> tuple[Disturbance, ...]:
    """Find the touches in one session; there are none where nothing that is left could move a fit.

    Args:
        stage: The session.
        residual: What the model leaves of it, shape (samples, rows).
        specimen: The robot.
    """
    session, motion = stage.session, stage.reading_rows
    rows = moving_columns(motion, stage.suite.units) & (np.isfinite(residual).mean(axis=0) > SEEN)
    if session.natural_frequency is not None or session.seconds < SHORTEST or not rows.any():
        return ()
    streams = stage.suite.measurements
    numbers = np.repeat(np.arange(len(streams)), [measurement.size for measurement in streams])[rows]
    units = tuple(unit for unit, moves in zip(stage.suite.units, rows, strict=True) if moves)
    step = max(window_of(session.seconds), session.step)

    def windows(values: Floats) -> Grid:
        return Grid.of(session.clock, session.pressures, values[:, rows], step, numbers, units)

    left = windows(residual)
    ranges = ranges_of(motion[:, rows])
    if not (np.abs(left.values) > least_sizes(units, ranges)).any():
        return ()
    least = np.array([LEAST[unit] for unit in units])
    usual = MAD_TO_STD * float(np.nanmedian(np.abs(left.values / least), axis=0).max())
    everywhere = np.ones(len(left.time), dtype=bool)
    fit = law_errors(left, everywhere, spreads=usual * least, sizes=tuple(size / usual for size in SIZES))
    if fit is None:
        return ()
    watched = Watched(
        session.name,
        (float(session.clock[0]), float(session.clock[-1])),
        tuple(measurement.name for measurement in streams),
        ranges,
        _levers(stage, specimen)[rows],
        tuple(range(session.pressures.shape[1])),
        slopes_of(windows(motion)),
    )
    return disturbances(fit, fit.chances(), watched)


def without_touches(session: Session, touches: Sequence[Disturbance]) -> Session:
    """Move what a session read during its touches to what no fit may see."""
    intervals = [touch.interval for touch in touches if touch.recording == session.name]
    if not intervals:
        return session
    during = inside(session.clock, intervals)[:, None]
    before = np.nan if session.event_readings is None else session.event_readings
    return replace(
        session,
        readings=np.where(during, np.nan, session.readings),
        event_readings=np.where(during, session.with_events.readings, before),
    )


def _levers(stage: Stage, specimen: Specimen) -> Floats:
    """Return how far the angle of each row moves the tip along x and y [m/rad], shape (rows, 2)."""
    levers = np.zeros((len(stage.suite.units), 2))
    for measurement in stage.suite.measurements:
        if isinstance(measurement, Bend):
            section = specimen.sections[measurement.section]
            levers[stage.suite.slices[measurement.name]] = tip_lever(specimen, section) * np.eye(2)
    return levers
