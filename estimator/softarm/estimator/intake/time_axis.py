"""The time column: its unit, by the stated rate, and pauses too long to be those of one recording."""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen

UNITS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
NEAR = 1.5
"""Factor within which steps agree with the stated rate."""
LONGEST_STEP = 0.5
"""From this step on [s] nobody knows the unit without a stated rate. An arm that swings once or twice a
second and is moved within a second needs more than two readings a second, and the milliseconds of a camera
of up to 2 kHz rise by at least as much."""
CLOSEST = 10.0
"""Percentile of the steps that shows the rate of a table of which many rows were left out."""
PAUSE = 20.0
"""Times the median step, and at least a second, from which a step is a pause."""
LONGEST_PAUSES = 7200.0
"""Longest time that the pauses of one recording last together [s]: those of an afternoon's series. After that
the air and the creep of the arm are others, and a clock that jumps goes on by a day or by all the seconds
since 1970. All steps of the intake look at windows of 0.05 s, which hold nothing over a pause."""


def correct_time(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:  # noqa: ARG001
    """Bring the time to seconds where another unit agrees with the stated rate.

    Refused are steps that agree in no unit, steps of unknown unit, and long pauses.
    """
    if len(recording.time) < 2:
        return recording, ()
    corrected, faults = _in_seconds(recording)
    return corrected, faults or _pauses(corrected)


def _in_seconds(recording: Recording) -> tuple[Recording, tuple[RecordingFault, ...]]:
    step = float(np.median(np.diff(recording.time)))
    rate = recording.info.get("rate_hz")
    if not isinstance(rate, int | float) or rate <= 0:
        if step < LONGEST_STEP:
            return recording, ()
        what = f"t_s rises by {step:.4g} from sample to sample, too slow for seconds"
        return recording, (
            _refused(recording, what, "convert it to seconds, or set rate_hz in recording.toml"),
        )
    steps = _steps(recording)
    unit = next((unit for unit, factor in UNITS.items() if _agree(steps * factor, rate)), "")
    if unit == "seconds":
        return recording, ()
    if not unit:
        what = (
            f"t_s rises by {step:.4g} a sample at a stated rate of {rate:g} Hz, which agrees in no unit"
            + (": it seems to count the samples" if step == 1.0 else "")
        )
        return recording, (
            _refused(recording, what, "give t_s in seconds, or correct rate_hz in recording.toml"),
        )
    what = f"t_s rises by {step:.4g} a sample at a stated rate of {rate:g} Hz: it is in {unit}"
    corrected = RecordingFault(recording.name, "unit", ("t_s",), what, "converted for this run")
    return replace(recording, time=recording.time * UNITS[unit]), (corrected,)


def _steps(recording: Recording) -> Floats:
    """Return the steps that may be those of the stated rate: of the rows, of close ones, of each column.

    Streams with time stamps of their own share rows with none, so that rows follow faster than readings.
    """
    steps = np.diff(recording.time)
    own = [np.diff(recording.time[np.isfinite(values)]) for values in recording.columns.values()]
    columns = [float(np.median(one)) for one in own if len(one)]
    return np.array([float(np.median(steps)), float(np.percentile(steps, CLOSEST)), *columns])


def _agree(steps: Floats, rate: float) -> bool:
    return bool(((steps * rate > 1.0 / NEAR) & (steps * rate < NEAR)).any())


def _refused(recording: Recording, what: str, cure: str) -> RecordingFault:
    return RecordingFault(recording.name, "unit", ("t_s",), what, cure, corrected=False)


def _pauses(recording: Recording) -> tuple[RecordingFault, ...]:
    """Refuse pauses that no recording holds, by the longest."""
    steps = np.diff(recording.time)
    usual = float(np.median(steps))
    together = float(steps[steps > max(1.0, PAUSE * usual)].sum())
    if together <= LONGEST_PAUSES:
        return ()
    place = int(np.argmax(steps))
    what = (
        f"t_s goes on by {_seconds(float(steps[place]))} s from row {place + 1} to row {place + 2}, its "
        f"usual step is {usual:.4g} s: a clock that jumped, or several recordings in one"
    )
    cure = f"correct t_s from row {place + 2} on, or give the rows before and after as two recordings"
    return (RecordingFault(recording.name, "clock", ("t_s",), what, cure, corrected=False),)


def _seconds(step: float) -> str:
    return f"{step:.0f}" if step < 1e7 else f"{step:.3g}"
