"""Validation of a calibration: poses that the pressures alone predict, beside the measured ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.response import BatchArmModel, BatchInputs
from softarm.estimator.sensing import MeasuredPose, SensorSuite
from softarm.estimator.sensing.model_error import widened
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import StretchLaw
from softarm.experiments.figures import Cells, error_figures, inside, with_paper, without_unit
from softarm.experiments.paper import VALIDATION_DEGREES, VALIDATION_MM

FEWEST_POSES = 5


@dataclass(frozen=True)
class PoseErrors:
    """Measured minus predicted pose of one section.

    Args:
        section: Its name.
        position: [m], shape (holds, 3).
        rotation: Rotation vector [rad], shape (holds, 3).
        position_std: Standard deviation of each component [m], shape (holds, 3).
        rotation_std: [rad], shape (holds, 3).
    """

    section: str
    position: Floats
    rotation: Floats
    position_std: Floats
    rotation_std: Floats

    @property
    def millimetres(self) -> Floats:
        """Size of each position error [mm], shape (holds,)."""
        return np.asarray(1e3 * np.linalg.norm(self.position, axis=1))

    @property
    def degrees(self) -> Floats:
        """Size of each rotation error [degrees], shape (holds,)."""
        return np.asarray(np.degrees(np.linalg.norm(self.rotation, axis=1)))


def predict(model: BatchArmModel, specimen: Specimen, holds: CalibrationRun) -> tuple[Frames, Flags]:
    """Predict the sections' frames from pressures and known forces, and where an equilibrium was found."""
    setting = Setting.of(specimen, StretchLaw.of(specimen, model.sections))
    gravity, loads = np.array(specimen.gravity_m_s2), np.nan_to_num(holds.loads)
    acting = setting.actuation.to_chamber(holds.pressures)
    response = setting.model(model).evaluate(BatchInputs(acting, loads, gravity))
    return response.frames, response.converged


def pose_errors(model: BatchArmModel, specimen: Specimen, holds: CalibrationRun) -> tuple[PoseErrors, ...]:
    """Compare predicted with measured poses, section by section.

    The deviation is that of the calibration's scatter on unseen blocks and of the sensors.

    Raises:
        InputError: There are too few poses, or no motion capture.
    """
    if len(holds.time) < FEWEST_POSES:
        raise InputError(
            holds.name,
            f"holds {len(holds.time)} poses for 2 s or longer",
            f"hold at least {FEWEST_POSES} random pressures, each for 5 s",
        )
    if not any(isinstance(sensor, MeasuredPose) for sensor in holds.suite.measurements):
        raise InputError(holds.name, "has no pose of a section", "record the bodies of the sections")
    frames, converged = predict(model, specimen, holds)
    innovation = holds.suite.sensitivity(frames, holds.readings).innovation
    innovation[~converged] = np.nan
    return by_section(innovation, pose_deviation(specimen, holds.suite), holds.suite)


def by_section(innovation: Floats, deviation: Floats, suite: SensorSuite) -> tuple[PoseErrors, ...]:
    """Split stacked innovations into those of each section whose pose is measured.

    Args:
        innovation: Measured minus predicted [m or rad], shape (holds, rows).
        deviation: Its standard deviation, shape (rows,).
        suite: The sensors.
    """
    std = np.broadcast_to(deviation, innovation.shape)
    errors = []
    for sensor in suite.measurements:
        if isinstance(sensor, MeasuredPose):
            first = suite.slices[sensor.name].start
            position, rotation = slice(first, first + 3), slice(first + 3, first + 6)
            name = sensor.name.removeprefix("frame_")
            parts = (innovation[:, position], innovation[:, rotation], std[:, position], std[:, rotation])
            errors.append(PoseErrors(name, *parts))
    return tuple(errors)


def pose_deviation(specimen: Specimen, suite: SensorSuite) -> Floats:
    """Return the standard deviation of measured minus predicted [m or rad], shape (rows,).

    It joins the sensors' noise and the scatter of the calibration on blocks that it had not seen.
    """
    spread = np.empty(suite.size)
    for sensor in widened(suite, specimen.calibration.scatter).measurements:
        variances = np.diag(sensor.covariance(np.zeros(sensor.reading_size)))
        spread[suite.slices[sensor.name]] = np.sqrt(variances)
    return spread


def rows(errors: Sequence[PoseErrors], label: str) -> list[Cells]:
    """Return one row a section and quantity; the last section's stand beside the paper's."""
    listed: list[Cells] = []
    for part in errors:
        last = part is errors[-1]
        parts = (
            ("position", "mm", part.millimetres, inside(part.position, part.position_std), VALIDATION_MM),
            ("orientation", "degrees", part.degrees, inside(part.rotation, part.rotation_std),
             VALIDATION_DEGREES),
        )  # fmt: skip
        for quantity, unit, sizes, share, published in parts:
            figures = error_figures(sizes, unit)
            named = without_unit(with_paper(figures, published, unit) if last else figures, unit)
            listed.append(
                {"run": label, "section": part.section, "quantity": quantity, "unit": unit}
                | {"poses": len(part.position)}
                | named
                | {"inside_2_std": share}
            )
    return listed
