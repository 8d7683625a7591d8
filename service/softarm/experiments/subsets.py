"""The same recording as other sensors would have made it: bends only, orientations only, poses only, all."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.errors import InputError
from softarm.estimator.sensing import Bend, MeasuredPose, Measurement, Orientation, SensorSuite

SUBSETS = ("bends", "orientations", "poses", "fused")


def subset(run: CalibrationRun, kind: str, noise: dict[str, float] | None = None) -> CalibrationRun:
    """Return a run whose suite holds one kind of sensor.

    Args:
        run: What was recorded.
        kind: ``bends``; ``orientations``, the rotations of the poses, as inertial units would give them;
            ``poses``; or ``fused``, everything.
        noise: Scatter of the calibration by sensor and quantity [m or rad], which is added to the sensors'
            own noise: a model is never exact.

    Raises:
        InputError: The recording has no such sensor.
    """
    chosen: list[Measurement] = []
    columns: list[Floats] = []
    for sensor in run.suite.measurements:
        part = run.readings[:, run.suite.reading_slices[sensor.name]]
        taken = _taken(sensor, part, kind)
        if taken is not None:
            chosen.append(_widened(taken[0], noise or {}))
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
    turned = Orientation(
        sensor.name.replace("frame_", "orientation_"),
        sensor.section,
        sensor.rotation_sigma,
        sensor.misalignment,
        sensor.registration,
    )
    return turned, readings[:, 3:]


def _widened(sensor: Measurement, noise: dict[str, float]) -> Measurement:
    """Add the calibration's scatter to a sensor's own noise."""
    widen: Callable[[Any, str], Any] = lambda own, name: np.hypot(own, noise.get(name, 0.0))  # noqa: E731
    if isinstance(sensor, MeasuredPose):
        return replace(
            sensor,
            position_sigma=widen(sensor.position_sigma, f"{sensor.name} position"),
            rotation_sigma=widen(sensor.rotation_sigma, f"{sensor.name} rotation"),
        )
    if isinstance(sensor, Orientation):
        name = sensor.name.replace("orientation_", "frame_")
        return replace(sensor, sigma=widen(sensor.sigma, f"{name} rotation"))
    if isinstance(sensor, Bend):
        return replace(sensor, sigma=widen(sensor.sigma, sensor.name))
    return sensor
