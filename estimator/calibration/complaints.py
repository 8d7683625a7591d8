"""What a recording lacks that a calibration could have used, with what to do about it."""

import numpy as np

from estimator.calibration.arrange import Run
from estimator.calibration.pulls import LEAST_PULL
from estimator.recording import Recording


def complaints(recording: Recording, run: Run) -> tuple[str, ...]:
    """Name gauges whose cord was slack or that were silent, and sensors that never answered.

    Args:
        recording: What was recorded.
        run: The same, arranged.
    """
    found = []
    for gauge in recording.gauges:
        tension = recording.gauge(gauge)
        if not np.isfinite(tension).any():
            found.append(f"{run.name}, gauge {gauge}: never answered; check its cable and its section")
        elif float(np.nanmax(np.abs(tension))) <= LEAST_PULL:
            found.append(
                f"{run.name}, gauge {gauge}: its cord was slack throughout, so it tells no force; "
                "move the gauge away until the cord is taut, then in small steps"
            )
    silent = (
        f"{run.name}, {name}: never answered; connect it or bring its markers into view, "
        "and record poses of more than 10 degrees"
        for name in silent_sensors(run)
    )
    return (*found, *silent)


def silent_sensors(run: Run) -> tuple[str, ...]:
    """Name the sensors of a run that have no reading at all."""
    found, start = [], 0
    for sensor in run.suite.measurements:
        part = run.readings[:, start : start + sensor.reading_size]
        start += sensor.reading_size
        if not np.isfinite(part).any():
            found.append(sensor.name)
    return tuple(found)
