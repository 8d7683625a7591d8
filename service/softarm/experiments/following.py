"""Estimates at chosen moments of a run, each reached through all that came before it."""

from typing import Any

import numpy as np

from softarm.analysis.offline.track import Waypoints, begin_near, settings
from softarm.common.errors import WorkFailedError
from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.inverse import ArmEstimate, Estimator
from softarm.estimator.model import ArmModel
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import stretched


def follow(
    model: ArmModel[Any, Any],
    specimen: Specimen,
    run: CalibrationRun,
    moments: Floats,
    waypoints: Waypoints[Any] | None = None,
) -> list[ArmEstimate[Any]]:
    """Follow a run and keep the estimates at some moments.

    Args:
        model: Model with the forces of a hand as unknown loads.
        specimen: The calibrated robot.
        run: What was recorded, at the rate of the estimates.
        moments: [s], shape (moments,).
        waypoints: States of the samples; with them, only the moments are estimated.

    Raises:
        WorkFailedError: An estimate at one of them did not converge.
    """
    estimator = Estimator(stretched(model, specimen), run.suite, settings(model.loads, specimen, run))
    gravity = np.array(specimen.gravity_m_s2)
    wanted = set(np.searchsorted(run.time, moments, side="right") - 1)
    kept = []
    for index, (time, readings, pressures) in enumerate(
        zip(run.time, run.readings, run.pressures, strict=True)
    ):
        if waypoints is not None:
            if index not in wanted:
                continue
            begin_near(estimator, waypoints, index, model.loads)
        estimate = estimator.update(float(time), readings, pressures, gravity)
        if index in wanted:
            if estimate.status == "diverged":
                raise WorkFailedError(f"{run.name}: the estimate at {time:.1f} s {estimate.status}")
            kept.append(estimate)
    return kept
