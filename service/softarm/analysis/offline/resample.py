"""A recording brought to a lower rate by means over even windows."""

from dataclasses import replace

import numpy as np

from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.errors import InputError
from softarm.estimator.series import window_means


def resample(run: CalibrationRun, rate: float) -> CalibrationRun:
    """Average a run over consecutive windows; a run that is slower already stays as it is.

    The mean of a window of length 1 / rate keeps motion faster than half the rate from appearing at lower
    frequencies. Windows without any reading are left out; a reading absent from a whole window stays NaN.

    Args:
        run: What was recorded.
        rate: Windows per second.

    Raises:
        InputError: The rate is not positive.
    """
    if not rate > 0:
        raise InputError("--rate", f"{rate} is not positive", "give samples per second, such as 10")
    steps = np.diff(run.time)
    if len(steps) == 0 or np.median(steps) >= 1.0 / rate:
        return run
    windows = ((run.time - run.time[0]) * rate + 1e-9).astype(np.int64)
    numbers, places = np.unique(windows, return_inverse=True)
    return replace(
        run,
        time=window_means(run.time[:, None], places, len(numbers))[:, 0],
        pressures=window_means(run.pressures, places, len(numbers)),
        readings=window_means(run.readings, places, len(numbers)),
        loads=window_means(run.loads, places, len(numbers)),
    )
