"""Recordings of an arm that nobody calibrated: the specimen is fitted to the recording itself."""

from collections.abc import Callable

import numpy as np

from softarm.analysis.offline.track import actuation
from softarm.common.rods import known_trusted_rod
from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import (
    CalibrationRefusedError,
    CalibrationRun,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
)
from softarm.estimator.calibration.nodes import choose_nodes
from softarm.estimator.calibration.search import search_axes
from softarm.estimator.recording import Recording
from softarm.estimator.response import BatchArmModel, BatchInputs
from softarm.estimator.sensing import Bend
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.specimen import Specimen

LEAST_DURATION = 30.0
"""Seconds that a recording must last: a short one does not separate a force from a pose."""
LEAST_ERROR = np.radians(3.0)
"""Rms error of a bend predicted from pressures above which the specimen is not that of the recording."""
BETTER = 2.0
"""Factor by which axes, gain and bias of its own must reduce that error."""
PROBES = 60
NODES = 160


def aligned(
    specimen: Specimen, recording: Recording, advance: Callable[[float], None] = lambda _: None
) -> tuple[Specimen, str]:
    """Calibrate a specimen on a recording of bends that it does not predict; else return it as it is.

    Nothing is done where the specimen was calibrated, where the recording is short, or where pressures
    predict the bends: the fit would attribute forces that act all along the recording to the pose.

    Returns:
        The specimen and what was done in one sentence, empty for nothing.
    """
    lasts = float(recording.time[-1] - recording.time[0])
    if not recording.bends or specimen.calibration.recordings or lasts < LEAST_DURATION:
        return specimen, ""
    model = quick_model(specimen, advance)
    run = arrange(recording, specimen, model.sections)
    foreign = _foreign(model, specimen, run)
    if not foreign:
        return specimen, ""
    what = f"{recording.name}: {specimen.name} as described does not predict {' and '.join(foreign)}"
    try:
        outcome = calibrate(model, specimen, [run], Options(nodes=NODES))
    except CalibrationRefusedError as refusal:
        return specimen, f"{what}, and cannot be fitted to it: {refusal.what}"
    return calibrated_specimen(specimen, outcome), (
        f"{what}; moduli, gains and axes were fitted to this recording first, so a force that acts all along "
        "it counts as pose (softarm calibrate keeps such a fit)"
    )


def quick_model(specimen: Specimen, advance: Callable[[float], None]) -> BatchArmModel:
    """Return the rod if one is stored that is near the finite elements, else these."""
    rod = known_trusted_rod(specimen)
    if rod is not None:
        return rod.with_loads(())
    return SequentialBatchModel(build_arm(specimen, loads=()), advance)


def _foreign(model: BatchArmModel, specimen: Specimen, run: CalibrationRun) -> tuple[str, ...]:
    """Name the bends that pressures predict badly, and far better with axes, gain and bias of their own."""
    nodes = choose_nodes(run, PROBES)
    none = np.zeros((len(nodes.time), 0))
    gravity = np.array(specimen.gravity_m_s2)
    pressures = actuation(specimen, run).to_chamber(nodes.pressures)
    response = model.evaluate(BatchInputs(pressures, none, gravity))
    solved, answer = nodes.keep(response.converged), response.at(response.converged)
    if len(solved.time) < 0.5 * PROBES:
        return tuple(m.name for m in run.suite.measurements if isinstance(m, Bend))
    residuals = solved.readings - run.suite.predict(answer.frames)
    fits = search_axes(run.suite, [solved], [answer.frames])
    return tuple(
        name
        for name, axes in fits.items()
        if (error := float(np.sqrt(np.nanmean(residuals[:, run.suite.slices[name]] ** 2)))) > LEAST_ERROR
        and error > BETTER * axes.rms
    )
