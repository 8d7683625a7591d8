"""What a calibrated model leaves unexplained, as noise of the sensors beside their own."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.model import Load
from softarm.estimator.sensing.bend import Bend
from softarm.estimator.sensing.measurement import Measurement
from softarm.estimator.sensing.orientation import Orientation
from softarm.estimator.sensing.section_pose import MeasuredPose
from softarm.estimator.sensing.suite import SensorSuite

VENTED_PA = 1.5e3
VENTED_PULLS = "vented pulls"
PRESSURISED_PULLS = "pressurised pulls"
"""Names of the conditions in the scatter of a calibration, as in ``frame_tip rotation, vented pulls``."""
ON = " on "
"""Between condition and section in the force ratios of a calibration, as in ``vented pulls on tip``."""
UNPULLED_ERROR = 0.05
"""Relative error of a force on a section of which no calibration states the error.

A calibration by pulls at the tip fits shear as bending; half way up that is wrong. Of the deflection of an
incompressible round cantilever of diameter d and length L, 0.625 (d / L)^2 is shear (S. P. Timoshenko, Phil.
Mag. 41, 1921): a twentieth for segments three to four diameters long.
"""


@dataclass(frozen=True, eq=False)
class Condition:
    """What a calibrated model leaves unexplained in one condition of the arm.

    Args:
        scatter: Root mean square of measured minus predicted by sensor and quantity, such as ``frame_tip
            rotation`` [m or rad].
        force_ratios: By section, root mean square of the error of an estimated force over the deviation that
            follows from the scatter: readings that err together, as a model's errors make them, do not err
            independently.
        relative_errors: Of forces, by section, beside that.
    """

    scatter: Mapping[str, float] = field(default_factory=dict)
    force_ratios: Mapping[str, float] = field(default_factory=dict)
    relative_errors: Mapping[str, float] = field(default_factory=dict)

    def force_ratio(self, section: str | None) -> float:
        """Return the ratio on a section, or the largest of all, and no less than 1, where it has none."""
        return self.force_ratios.get(section or "", max((1.0, *self.force_ratios.values())))

    def load_ratio(self, load: Load) -> float:
        """Return the ratio of a load on its section.

        Pulls show that of lateral forces. Axial forces and moments show in other readings, where pulls of
        cords hardly show how the model errs: their deviation is no less than the scatter makes it.
        """
        ratio = self.force_ratio(load.section)
        lateral = load.kind == "force" and abs(load.direction[2]) < np.hypot(*load.direction[:2])
        return ratio if lateral else max(1.0, ratio)

    def relative_error(self, section: str | None) -> float:
        """Return the relative error of a force on a section."""
        return self.relative_errors.get(section or "", UNPULLED_ERROR)


@dataclass(frozen=True)
class ModelError:
    """What a calibrated model leaves unexplained while a force acts, as the calibration measured it.

    An arm that hangs vented stays near rest and scatters less than one under pressure.

    Args:
        vented: While every chamber is vented.
        pressurised: While any chamber holds pressure.
    """

    vented: Condition = field(default_factory=Condition)
    pressurised: Condition = field(default_factory=Condition)

    @classmethod
    def of(
        cls,
        scatter: Mapping[str, float],
        force_ratio: Mapping[str, float] | None = None,
        force_error: Mapping[str, float] | None = None,
    ) -> "ModelError":
        """Sort what a calibration measured by condition; scatter without forces stands in for the rest.

        Args:
            scatter: By sensor, quantity and condition [m or rad].
            force_ratio: By condition and section, such as ``vented pulls on tip``.
            force_error: Relative error of forces, likewise.
        """
        plain = {name: value for name, value in scatter.items() if ", " not in name}

        def on(condition: str, by_name: Mapping[str, float] | None) -> dict[str, float]:
            start = f"{condition}{ON}"
            return {n.removeprefix(start): v for n, v in (by_name or {}).items() if n.startswith(start)}

        def under(condition: str) -> Condition:
            ending = f", {condition}"
            pulled = {n.removesuffix(ending): value for n, value in scatter.items() if n.endswith(ending)}
            return Condition(plain | pulled, on(condition, force_ratio), on(condition, force_error))

        return cls(under(VENTED_PULLS), under(PRESSURISED_PULLS))

    @property
    def conditions(self) -> tuple[Condition, Condition]:
        """Both conditions."""
        return self.vented, self.pressurised

    def at(self, pressures: Floats) -> Condition:
        """Return the condition at measured pressures [Pa], lost ones taken as 0, shape (chambers,)."""
        return self.pressurised if (pressures >= VENTED_PA).any() else self.vented


def vented(pressures: Floats) -> Flags:
    """Return which samples of pressures [Pa], shape (..., chambers), are vented, shape (...)."""
    return np.asarray((pressures < VENTED_PA).all(axis=-1))


def widened(suite: SensorSuite, scatter: Mapping[str, float]) -> SensorSuite:
    """Return a suite whose sensors are as noisy as the model and they are together.

    Args:
        suite: The sensors.
        scatter: Of the model by sensor and quantity [m or rad]; independent of the sensors' own noise.
    """
    return SensorSuite(tuple(_widened(sensor, scatter) for sensor in suite.measurements))


def _widened(sensor: Measurement, scatter: Mapping[str, float]) -> Measurement:
    def joined(own: float | Floats, name: str) -> Any:
        return np.hypot(own, scatter.get(name, 0.0))

    def rotated(own: float | Floats, name: str) -> Floats:
        tilt = f"{name} rotation"
        torsion = f"{name} torsion"  # part of the rotation in earlier calibrations
        both = [joined(own, tilt), joined(own, torsion if torsion in scatter else tilt)]
        return np.asarray(np.where([True, True, False], *both), dtype=np.float64)

    if isinstance(sensor, MeasuredPose):
        return replace(
            sensor,
            position_sigma=joined(sensor.position_sigma, f"{sensor.name} position"),
            rotation_sigma=rotated(sensor.rotation_sigma, sensor.name),
        )
    if isinstance(sensor, Orientation | Bend) and sensor.name in scatter:
        return replace(sensor, sigma=joined(sensor.sigma, sensor.name))
    # Where a calibration recorded frames alone, the model errs as much in the rotation of their sections.
    if isinstance(sensor, Orientation):
        return replace(sensor, sigma=rotated(sensor.sigma, sensor.name.replace("orientation_", "frame_")))
    if isinstance(sensor, Bend):
        as_pose = f"{sensor.name.replace('bend_', 'frame_')} rotation"
        return replace(sensor, sigma=joined(sensor.sigma, as_pose))
    return sensor
