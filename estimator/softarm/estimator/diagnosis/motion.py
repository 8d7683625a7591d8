"""Recordings as a diagnosis saw them, with the predicted poses and what every channel is off by.

| column | content |
|---|---|
| ``pressure_<k>_pa``, ``frame_...``, ``bend_...``, ``marker_...`` | readings, averaged as for the diagnosis |
| ``estimate_frame_<section>_...`` | pose that the calibrated model predicts without the findings |
| ``estimate_residual_<before, after>_<channel>_<unit>`` | measured minus predicted, without and with them |
| ``estimate_heldout`` | 1 where neither a fit nor a choice has seen the sample, else 0 |
"""

import numpy as np
from scipy.spatial.transform import Rotation

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.innovations import Residuals
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.recording import BEND_SUFFIXES, MARKER_SUFFIXES, POSE_SUFFIXES, Recording

POINTS = 1000
"""Samples of a recording that are kept."""
SUFFIXES = {"frame": POSE_SUFFIXES, "bend": BEND_SUFFIXES, "marker": MARKER_SUFFIXES}
HELDOUT = "estimate_heldout"


def residual_column(which: str, channel: str, unit: str) -> str:
    """Name the column of a residual: ``before`` or ``after`` the findings, of a channel in its unit."""
    return f"estimate_residual_{which}_{channel.replace('.', '_')}_{unit.lower()}"


def motions_of(evidence: RegressionProblem, before: Residuals, after: Residuals) -> tuple[Recording, ...]:
    """Return every recording in question; its time begins at 0.

    Args:
        evidence: All recordings.
        before: Residuals of each session without the findings, shape (samples, rows).
        after: The same with them.
    """
    return tuple(
        _motion(stage, {"before": before[number], "after": after[number]})
        for number, stage in enumerate(evidence.stages)
        if not stage.session.nominal
    )


def _motion(stage: Stage, residuals: dict[str, Floats]) -> Recording:
    session = stage.session
    columns = {f"pressure_{k}_pa": pressure for k, pressure in enumerate(session.pressures.T)}
    for sensor, entries in stage.suite.reading_slices.items():
        suffixes = SUFFIXES.get(sensor.partition("_")[0], ())  # no table holds orientations alone
        names = (f"{sensor}_{suffix}" for suffix in suffixes)
        columns |= dict(zip(names, session.readings[:, entries].T, strict=False))
    columns |= _poses(stage)
    for which, residual in residuals.items():
        for name, unit, column in zip(channels(stage.suite), stage.suite.units, residual.T, strict=True):
            columns[residual_column(which, name, unit)] = column
    columns[HELDOUT] = session.reported.astype(float)
    thin = slice(None, None, -(-session.samples // POINTS))
    return Recording(
        session.name, session.time[thin], {name: column[thin] for name, column in columns.items()}
    )


def _poses(stage: Stage) -> dict[str, Floats]:
    """Return the columns of the predicted poses, NaN where the model found no equilibrium."""
    response = stage.arm.baseline
    columns = {}
    for number, section in enumerate(stage.world.sections):
        quaternions = Rotation.from_matrix(response.frames.rotations[:, number]).as_quat(scalar_first=True)
        poses = np.hstack([response.frames.positions[:, number], quaternions])
        poses[~response.converged] = np.nan
        for suffix, column in zip(POSE_SUFFIXES, poses.T, strict=True):
            columns[f"estimate_frame_{section}_{suffix}"] = column
    return columns
