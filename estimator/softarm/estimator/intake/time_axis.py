"""The time column: its unit, by the stated rate, and pauses too long to be those of one recording."""

from dataclasses import replace

import numpy as np

from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen

UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
NEAR = 1.5
"""Factor within which steps agree with the stated rate."""
LONGEST_STEP = 2.0
"""Steps longer than this [s] show no motion; without a stated rate nobody knows their unit."""
PAUSE = 20.0
"""Times the median step, and at least a second, from which a step is a pause."""
LONGEST_PAUSES = 7200.0
"""Longest time that the pauses of one recording last together [s]: those of an afternoon's series. After that
the air and the creep of the arm are others, and a clock that jumps goes on by a day or by all the seconds
since 1970. All steps of the intake look at windows of 0.05 s, which hold nothing over a pause."""


def mend_time(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:  # noqa: ARG001
    """Bring the time to seconds where only another unit agrees with the stated rate; refuse long pauses."""
    if len(recording.time) < 2:
        return recording, ()
    mended, faults = _in_seconds(recording)
    return mended, faults or _pauses(mended)


def _in_seconds(recording: Recording) -> tuple[Recording, tuple[RecordingFault, ...]]:
    step = float(np.median(np.diff(recording.time)))
    rate = recording.info.get("rate_hz")
    if isinstance(rate, int | float) and rate > 0:
        for unit, factor in UNITS.items():
            if 1.0 / NEAR < step * factor * rate < NEAR:
                what = f"t_s rises by {step:.4g} a sample at a stated rate of {rate:g} Hz: it is in {unit}"
                time = recording.time * factor
                mended = RecordingFault(recording.name, "unit", ("t_s",), what, "converted for this run")
                return replace(recording, time=time), (mended,)
    elif step > LONGEST_STEP:
        what = f"t_s rises by {step:.4g} from sample to sample, too slow for seconds"
        cure = "convert it to seconds, or set rate_hz in recording.toml"
        return recording, (RecordingFault(recording.name, "unit", ("t_s",), what, cure, mended=False),)
    return recording, ()


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
    return (RecordingFault(recording.name, "clock", ("t_s",), what, cure, mended=False),)


def _seconds(step: float) -> str:
    return f"{step:.0f}" if step < 1e7 else f"{step:.3g}"
