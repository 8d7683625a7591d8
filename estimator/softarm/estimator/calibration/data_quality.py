"""Data that a calibration could have used but a recording lacks, and how to record them."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.arrange import CalibrationRun
from softarm.estimator.calibration.pulls import HOOK, LEAST_PULL
from softarm.estimator.recording import Recording

NEAR_MOST = 0.8  # of a gauge's largest reading
LONGEST_GAP = 0.5  # s between two readings of a gauge within its range


def data_quality_notes(recording: Recording, run: CalibrationRun) -> tuple[str, ...]:
    """Name gauges that were slack, silent or beyond their range, and sensors that never answered."""
    notes = []
    tied = HOOK in recording.markers or not {"gauge_section", "gauge_direction"}.isdisjoint(recording.info)
    for gauge in recording.gauges:
        tension = recording.gauge(gauge)
        beyond = silent_at_most(recording.time, tension)
        if not np.isfinite(tension).any():
            notes.append(f"{run.name}, gauge {gauge}: never answered; check its cable and its section")
        elif beyond:
            notes.append(
                f"{run.name}, gauge {gauge}: saturated gauge: silent for {beyond:.1f} s where it pulled "
                "most, as beyond its range; pull less, or with a larger gauge"
            )
        elif tied and float(np.nanmax(np.abs(tension))) <= LEAST_PULL:
            notes.append(
                f"{run.name}, gauge {gauge}: its cord was slack throughout, so it measured no force; "
                "move the gauge away until the cord is taut, then in small steps"
            )
    silent = (
        f"{run.name}, {name}: never answered; connect it or bring its markers into view, "
        "and record poses of more than 10 degrees"
        for name in silent_sensors(run)
    )
    return (*notes, *silent)


def silent_at_most(time: Floats, tension: Floats) -> float:
    """Return the time in gaps between a gauge's readings near to its largest [s], 0 where there is none.

    Args:
        time: [s], shape (samples,).
        tension: Its readings [N], NaN where there is none, shape (samples,).
    """
    pull = np.abs(tension)
    observed = np.isfinite(pull)
    times, pulls = time[observed], pull[observed]
    if len(times) < 3 or pulls.max() <= LEAST_PULL:
        return 0.0
    gaps = np.diff(times)
    high = pulls > NEAR_MOST * pulls.max()
    long = gaps > max(LONGEST_GAP, 10.0 * float(np.median(gaps)))
    return float(gaps[long & high[:-1] & high[1:]].sum())


def silent_sensors(run: CalibrationRun) -> tuple[str, ...]:
    """Name the sensors of a run that have no reading at all."""
    slices = run.suite.reading_slices
    return tuple(name for name, columns in slices.items() if not np.isfinite(run.readings[:, columns]).any())
