"""The unknowns of a calibration, what is known of them beforehand, and what they stand for in the model."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimator.sensing import ActuationMap, Bend, SectionPose, SensorSuite
from estimator.specimen import Specimen

Floats = NDArray[np.float64]
Kind = Literal["modulus", "gain", "bias", "alignment"]

MODULUS_SPREAD = np.log(2.0)  # fitted shear moduli of such arms range from 35 to 152 kPa
GAIN_SPREAD = 0.15
MEAN_GAIN_SPREAD = 0.02  # a set of pressure sensors is right on average; divides gains from moduli
BIAS_SPREAD = 1.0e3  # Pa
NOMINAL_BIAS_SPREAD = 3.0e3  # Pa, where nobody measured the pressure
ALIGNMENT_SPREAD = {
    "in_plane": np.pi / 2,
    "bias_x": 0.15,
    "bias_y": 0.15,
    "reference_tilt_x": 0.1,
    "reference_tilt_y": 0.1,
    "section_tilt_x": 0.1,
    "section_tilt_y": 0.1,
    "misalignment_x": 0.15,
    "misalignment_y": 0.15,
    "misalignment_z": np.pi / 2,
    "offset_x": 0.02,
    "offset_y": 0.02,
    "offset_z": 0.02,
}
"""Standard deviation of what is known beforehand of each alignment parameter [rad or m]."""

BEND_ALIGNMENT = ("in_plane", "bias_x", "bias_y")
POSE_ALIGNMENT = SectionPose.parameter_names


@dataclass(frozen=True)
class Parameter:
    """One unknown.

    Args:
        name: ``modulus.upper``, ``gain.3``, ``bias.3``, ``bend_tip.in_plane``.
        kind: What it acts on.
        target: Segment, chamber or ``<sensor>.<parameter>``.
        unit: Its unit; a modulus is the logarithm of a factor.
        mean: What is known beforehand.
        spread: Standard deviation of that.
    """

    name: str
    kind: Kind
    target: str
    unit: str
    mean: float
    spread: float


@dataclass(frozen=True)
class Setting:
    """What values of the unknowns stand for.

    Args:
        scales: Factor on the stiffness of each segment.
        actuation: From recorded to acting pressures.
        alignment: Values of sensors' parameters by ``<sensor>.<parameter>``.
    """

    scales: Mapping[str, float]
    actuation: ActuationMap
    alignment: Mapping[str, float]

    def aligned(self, suite: SensorSuite) -> SensorSuite:
        """Give a suite with the alignment."""
        values = suite.parameters.copy()
        for index, name in enumerate(suite.parameter_names):
            values[index] = self.alignment.get(name, values[index])
        return suite.with_parameters(values)


@dataclass(frozen=True)
class Layout:
    """The unknowns in order, and the linear combinations that are known beforehand.

    Args:
        parameters: The unknowns.
        settled: What holds of all that is not among them.
        combinations: Rows over all unknowns whose sums are known, shape (combinations, unknowns).
        combination_means: Known values, shape (combinations,).
        combination_spreads: Standard deviations, shape (combinations,).
    """

    parameters: tuple[Parameter, ...]
    settled: Setting
    combinations: Floats
    combination_means: Floats
    combination_spreads: Floats

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def means(self) -> Floats:
        """What is known beforehand, shape (unknowns,)."""
        return np.array([parameter.mean for parameter in self.parameters])

    @property
    def spreads(self) -> Floats:
        """Standard deviation of that, shape (unknowns,)."""
        return np.array([parameter.spread for parameter in self.parameters])

    def setting(self, values: Floats) -> Setting:
        """Tell what values stand for, shape (unknowns,)."""
        scales, alignment = dict(self.settled.scales), dict(self.settled.alignment)
        gain, bias = self.settled.actuation.gain.copy(), self.settled.actuation.bias.copy()
        for parameter, value in zip(self.parameters, values.tolist(), strict=True):
            if parameter.kind == "modulus":
                scales[parameter.target] = float(np.exp(value))
            elif parameter.kind == "gain":
                gain[int(parameter.target)] = value
            elif parameter.kind == "bias":
                bias[int(parameter.target)] = value
            else:
                alignment[parameter.target] = value
        return Setting(scales, ActuationMap(gain, bias), alignment)

    def without(self, names: Collection[str]) -> "Layout":
        """Settle some unknowns at what is known of them beforehand."""
        out = np.array([name in names for name in self.names], dtype=bool)
        return Layout(
            tuple(p for p, settled in zip(self.parameters, out, strict=True) if not settled),
            self.setting(self.means),
            self.combinations[:, ~out],
            self.combination_means - self.combinations[:, out] @ self.means[out],
            self.combination_spreads,
        )

    def prior_rows(self, values: Floats) -> tuple[Floats, Floats]:
        """Give what is known beforehand as whitened residuals and their derivative.

        Returns:
            (known - value) / spread, shape (rows,), and the derivative of value / spread, (rows, unknowns).
        """
        own = (self.means - values) / self.spreads
        sums = (self.combination_means - self.combinations @ values) / self.combination_spreads
        rows = np.vstack([np.diag(1.0 / self.spreads), self.combinations / self.combination_spreads[:, None]])
        return np.concatenate([own, sums]), rows

    def prior_covariance(self) -> Floats:
        """Give the covariance of what is known beforehand, shape (unknowns, unknowns)."""
        _, rows = self.prior_rows(self.means)
        covariance: Floats = np.asarray(np.linalg.inv(rows.T @ rows), dtype=np.float64)
        return covariance


def build_layout(
    specimen: Specimen,
    suite: SensorSuite,
    pressure_sources: Sequence[str],
    moved_chambers: Sequence[int],
    regions: Sequence[str],
) -> Layout:
    """Choose the unknowns for what was recorded.

    Args:
        specimen: The robot, its present calibration among what is known.
        suite: The sensors.
        pressure_sources: ``measured``, ``commanded`` or ``none`` of each chamber.
        moved_chambers: Chambers whose pressure varied; the others keep their calibration.
        regions: Regions of the model whose stiffness can be scaled.
    """
    calibration = specimen.calibration
    parameters = [
        Parameter(
            f"modulus.{s.name}",
            "modulus",
            s.name,
            "log factor",
            float(np.log(calibration.scale(s.name))),
            MODULUS_SPREAD,
        )
        for s in specimen.segments
        if s.name in regions
    ]
    for k in moved_chambers:
        found = calibration.chamber(k)
        spread = BIAS_SPREAD if pressure_sources[k] == "measured" else NOMINAL_BIAS_SPREAD
        parameters.append(Parameter(f"gain.{k}", "gain", str(k), "-", found.gain.value, GAIN_SPREAD))
        parameters.append(Parameter(f"bias.{k}", "bias", str(k), "Pa", found.bias_pa.value, spread))
    parameters += _alignment(suite)
    return _with_mean_gains(specimen, tuple(parameters))


def _alignment(suite: SensorSuite) -> list[Parameter]:
    parameters = []
    values = dict(zip(suite.parameter_names, suite.parameters.tolist(), strict=True))
    for sensor in suite.measurements:
        if isinstance(sensor, Bend):
            names: tuple[str, ...] = BEND_ALIGNMENT
        elif isinstance(sensor, SectionPose):
            names = POSE_ALIGNMENT
        else:
            names = ()
        for name in names:
            full = f"{sensor.name}.{name}"
            unit = "m" if name.startswith("offset") else "rad"
            parameters.append(
                Parameter(full, "alignment", full, unit, values[full], float(ALIGNMENT_SPREAD[name]))
            )
    return parameters


def _with_mean_gains(specimen: Specimen, parameters: tuple[Parameter, ...]) -> Layout:
    """Add that the mean gain of each segment's chambers is known: it divides gains from the modulus."""
    rows, means = [], []
    for segment in specimen.segments:
        members = {str(chamber.index) for chamber in specimen.chambers if chamber.segment == segment.name}
        row = np.array([float(p.kind == "gain" and p.target in members) for p in parameters])
        if row.any():
            rows.append(row / row.sum())
            means.append(float(row @ [p.mean for p in parameters] / row.sum()))
    found = [specimen.calibration.chamber(chamber.index) for chamber in specimen.chambers]
    actuation = ActuationMap(
        np.array([entry.gain.value for entry in found]), np.array([entry.bias_pa.value for entry in found])
    )
    scales = {name: value.value for name, value in specimen.calibration.modulus_scale.items()}
    return Layout(
        parameters,
        Setting(scales, actuation, {}),
        np.array(rows).reshape(-1, len(parameters)),
        np.array(means),
        np.full(len(rows), MEAN_GAIN_SPREAD),
    )
