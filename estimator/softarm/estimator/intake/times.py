"""The unit of the time column, by the rate that the recording states."""

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


def mend_time(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:  # noqa: ARG001
    """Bring the time to seconds where only another unit agrees with the stated rate."""
    if len(recording.time) < 2:
        return recording, ()
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
