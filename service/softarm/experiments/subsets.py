"""The same recording as other sensors would have made it: bends only, orientations only, poses only, all."""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.errors import InputError
from softarm.estimator.sensing import Bend, MeasuredPose, Measurement, Orientation, SensorSuite

SUBSETS = ("bends", "orientations", "poses", "fused")


def subset(run: CalibrationRun, kind: str) -> CalibrationRun:
    """Return a run whose suite holds one kind of sensor.

    Args:
        run: What was recorded.
        kind: ``bends``; ``orientations``, the rotations of the poses, as inertial units would report them;
            ``poses``; or ``fused``, everything.

    Raises:
        InputError: The recording has no such sensor.
    """
    chosen: list[Measurement] = []
    columns: list[Floats] = []
    for sensor in run.suite.measurements:
        part = run.readings[:, run.suite.reading_slices[sensor.name]]
        taken = _taken(sensor, part, kind)
        if taken is not None:
            chosen.append(taken[0])
            columns.append(taken[1])
    if not chosen:
        raise InputError(run.name, f"holds nothing for '{kind}'", f"choose one of {', '.join(SUBSETS)}")
    return replace(run, suite=SensorSuite(tuple(chosen)), readings=np.concatenate(columns, axis=1))


def _taken(sensor: Measurement, readings: Floats, kind: str) -> tuple[Measurement, Floats] | None:
    if kind == "fused":
        return sensor, readings
    if kind == "bends":
        return (sensor, readings) if isinstance(sensor, Bend) else None
    if not isinstance(sensor, MeasuredPose):
        return None
    if kind == "poses":
        return sensor, readings
    rotated = Orientation(
        sensor.name.replace("frame_", "orientation_"),
        sensor.section,
        sensor.rotation_sigma,
        sensor.misalignment,
        sensor.registration,
    )
    return rotated, readings[:, 3:]
