"""The unknowns of a calibration, what is known of them beforehand, and what they stand for in the model."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.rotations import exp
from softarm.estimator.sensing import (
    ActuationMap,
    Bend,
    Measurement,
    Orientation,
    Registration,
    SectionPose,
    SensorSuite,
)
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import StretchLaw

Floats = NDArray[np.float64]
Kind = Literal[
    "modulus", "gain", "curve", "bow", "bias", "crosstalk", "stretch", "alignment", "base", "gravity", "cord"
]

MODULUS_SPREAD = np.log(2.0)  # fitted shear moduli of such arms range from 35 to 152 kPa
GAIN_SPREAD = 0.15
MEAN_GAIN_SPREAD = 0.02  # a set of pressure sensors is right on average; divides gains from moduli
AREA_SPREAD = 0.3  # of the area that the pressures push on, where known pulls tell the moduli
CURVE_SPREAD = 5e-6  # 1/Pa; a winding may give way by a quarter over the working range
BOW_SPREAD = 1e-10  # 1/Pa2; and its growth may change by as much again
CROSSTALK_SPREAD = 0.02  # chambers lie within a degree or two of their drawing
STRETCH_SPREAD = 1.0  # a chamber's area shrinks about as much as its length grows, or the winding keeps it
BIAS_SPREAD = 1.0e3  # Pa
NOMINAL_BIAS_SPREAD = 3.0e3  # Pa, where nobody measured the pressure
TURN_SPREAD = 0.03  # rad; the body on the base is mounted to two degrees
SHIFT_SPREAD = 1e-3  # m
GRAVITY_SPREAD = 0.01  # rad; a mount is levelled to half a degree
CORD_SPREAD = 0.1  # rad
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
        target: Segment, chamber, axis or ``<sensor>.<parameter>``; for cross-talk ``<to>.<from>``.
        unit: Its unit; a modulus is the logarithm of a factor.
        mean: What is known beforehand.
        spread: Standard deviation of that.
        chambers: Chambers it acts on, for a curve; for cross-talk where it acts and whose pressure it is.
    """

    name: str
    kind: Kind
    target: str
    unit: str
    mean: float
    spread: float
    chambers: tuple[int, ...] = ()

    @property
    def place(self) -> Any:
        """Where it stands in an array of its kind."""
        if self.kind in ("curve", "bow"):
            return list(self.chambers)
        return self.chambers if self.kind == "crosstalk" else int(self.target)


@dataclass(frozen=True)
class Setting:
    """What values of the unknowns stand for.

    Args:
        scales: Factor on the stiffness of each segment.
        actuation: From recorded to acting pressures.
        alignment: Values of sensors' parameters by ``<sensor>.<parameter>``.
        base: Twist (v [m], w [rad]) by which registered readings are moved, shape (6,): the mounting of the
            body on the base.
        gravity_tilt: Rotation of gravity [rad] about the two axes of ``gravity_axes``, shape (2,).
        cord_azimuth: Rotation of all known pulls about the base frame's z [rad].
        stretch: What stretching the chambers is worth; ``None`` for nothing.
    """

    scales: Mapping[str, float]
    actuation: ActuationMap
    alignment: Mapping[str, float]
    base: Floats = field(default_factory=lambda: np.zeros(6))
    gravity_tilt: Floats = field(default_factory=lambda: np.zeros(2))
    cord_azimuth: float = 0.0
    stretch: StretchLaw | None = None

    def aligned(self, suite: SensorSuite) -> SensorSuite:
        """Give a suite with the alignment, and registered with the base as it is mounted."""
        values = suite.parameters.copy()
        for index, name in enumerate(suite.parameter_names):
            values[index] = self.alignment.get(name, values[index])
        turned = suite.with_parameters(values)
        if not self.base.any():
            return turned
        return turned.moved(self.base)

    def gravity(self, gravity: Floats) -> Floats:
        """Tilt gravity [m/s2], shape (3,)."""
        turned: Floats = exp(self.gravity_tilt @ gravity_axes(gravity)) @ gravity
        return turned

    def pulls(self, loads: Floats) -> Floats:
        """Turn known forces, three components a section, about z, shape (nodes, loads)."""
        if not loads.size:
            return loads
        turn = exp(np.array([0.0, 0.0, self.cord_azimuth]))
        turned: Floats = (loads.reshape(len(loads), -1, 3) @ turn.T).reshape(loads.shape)
        return turned


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
        actuation = self.settled.actuation
        count = len(actuation.gain)
        arrays = {
            "gain": actuation.gain.copy(),
            "bias": actuation.bias.copy(),
            "curve": np.broadcast_to(actuation.curve, count).copy(),
            "bow": np.broadcast_to(actuation.bow, count).copy(),
            "crosstalk": np.broadcast_to(actuation.crosstalk, (count, count)).copy(),
            "base": self.settled.base.copy(),
            "gravity": self.settled.gravity_tilt.copy(),
        }
        azimuth, stretch = self.settled.cord_azimuth, self.settled.stretch
        for parameter, value in zip(self.parameters, values.tolist(), strict=True):
            match parameter.kind:
                case "modulus":
                    scales[parameter.target] = float(np.exp(value))
                case "stretch" if stretch is not None:
                    stretch = replace(stretch, gain=value)
                case "cord":
                    azimuth = value
                case "alignment":
                    alignment[parameter.target] = value
                case kind:
                    arrays[kind][parameter.place] = value
        actuation = ActuationMap(
            arrays["gain"],
            arrays["bias"],
            curve=arrays["curve"],
            bow=arrays["bow"],
            crosstalk=arrays["crosstalk"],
        )
        base, tilt = arrays["base"], arrays["gravity"]
        return Setting(scales, actuation, alignment, base, tilt, azimuth, stretch)

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
    pulled: bool = False,
    sections: tuple[str, ...] = (),
) -> Layout:
    """Choose the unknowns for what was recorded.

    Args:
        specimen: The robot, its present calibration among what is known.
        suite: The sensors.
        pressure_sources: ``measured``, ``commanded`` or ``none`` of each chamber.
        moved_chambers: Chambers whose pressure varied; the others keep their calibration.
        regions: Regions of the model whose stiffness can be scaled.
        pulled: Whether known forces are among the data: they tell the moduli, so that the area that the
            pressures push on need not be known.
        sections: Sections of the model, for what needs them: with known forces on an arm that has several
            chambers a segment, cross-talk, the bow of the gains and what stretching a chamber is worth are
            among the unknowns. Left out, a stretch that was calibrated counts for nothing.
    """
    calibration = specimen.calibration
    gain_spread = float(np.hypot(GAIN_SPREAD, AREA_SPREAD)) if pulled else GAIN_SPREAD
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
        parameters.append(Parameter(f"gain.{k}", "gain", str(k), "-", found.gain.value, gain_spread))
        parameters.append(Parameter(f"bias.{k}", "bias", str(k), "Pa", found.bias_pa.value, spread))
    parameters += _curves(specimen, moved_chambers)
    if pulled and sections:
        parameters += _finer(specimen, moved_chambers)
    parameters += _alignment(suite)
    parameters += _surroundings(suite, pulled)
    wanted = sections and (pulled or calibration.stretch_gain.value)
    stretch = StretchLaw.of(specimen, sections) if wanted else None
    spread = AREA_SPREAD if pulled else MEAN_GAIN_SPREAD
    return _with_mean_gains(specimen, tuple(parameters), spread, stretch)


def gravity_axes(gravity: Floats) -> Floats:
    """Give two unit axes across gravity, shape (2, 3): x and y where it points along z."""
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-12)
    first = np.cross([0.0, 1.0, 0.0] if abs(down[1]) < 0.9 else [0.0, 0.0, 1.0], down)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(down, first)])


def _curves(specimen: Specimen, moved: Sequence[int]) -> list[Parameter]:
    """Let the gains of a segment's chambers grow with the pressure, all by the same share."""
    parameters = []
    for segment in specimen.segments:
        members = tuple(c.index for c in specimen.chambers if c.segment == segment.name and c.index in moved)
        if members:
            known = float(np.mean([specimen.calibration.chamber(k).curve_per_pa.value for k in members]))
            name = f"curve.{segment.name}"
            parameters.append(Parameter(name, "curve", segment.name, "1/Pa", known, CURVE_SPREAD, members))
    return parameters


def _finer(specimen: Specimen, moved: Sequence[int]) -> list[Parameter]:
    """Give what only recordings of pulls and of pressures together can tell."""
    calibration = specimen.calibration
    parameters = [Parameter("stretch", "stretch", "all", "-", calibration.stretch_gain.value, STRETCH_SPREAD)]
    for curve in _curves(specimen, moved):
        known = float(np.mean([calibration.chamber(k).bow_per_pa2.value for k in curve.chambers]))
        name = f"bow.{curve.target}"
        parameters.append(Parameter(name, "bow", curve.target, "1/Pa2", known, BOW_SPREAD, curve.chambers))
    for row in (chamber.index for chamber in specimen.chambers):
        shares = calibration.chamber(row).crosstalk or (0.0,) * len(specimen.chambers)
        parameters += [
            Parameter(
                f"crosstalk.{row}.{k}", "crosstalk", f"{row}.{k}", "-", shares[k], CROSSTALK_SPREAD, (row, k)
            )
            for k in moved
            if k != row
        ]
    return parameters


def _registered_by_body(sensor: Measurement) -> bool:
    """Tell whether a sensor rests on the pose of one body; markers on the base tell their own error."""
    return sensor.registration is not None and not sensor.registration.covariance.any()


def _surroundings(suite: SensorSuite, pulled: bool) -> list[Parameter]:
    """Leave open how the base's body is mounted, where gravity points, and where the cord pulls."""
    found = []
    if any(_registered_by_body(sensor) for sensor in suite.measurements):
        names = ("shift_x", "shift_y", "shift_z", "turn_x", "turn_y", "turn_z")
        for number, name in enumerate(names):
            unit, spread = ("m", SHIFT_SPREAD) if number < 3 else ("rad", TURN_SPREAD)
            found.append(Parameter(f"base.{name}", "base", str(number), unit, 0.0, spread))
    for number, name in enumerate(("tilt_x", "tilt_y")):
        found.append(Parameter(f"gravity.{name}", "gravity", str(number), "rad", 0.0, GRAVITY_SPREAD))
    if pulled:
        found.append(Parameter("cord.azimuth", "cord", "azimuth", "rad", 0.0, CORD_SPREAD))
    return found


def _alignment(suite: SensorSuite) -> list[Parameter]:
    parameters = []
    values = dict(zip(suite.parameter_names, suite.parameters.tolist(), strict=True))
    for sensor in suite.measurements:
        if isinstance(sensor, Bend):
            names: tuple[str, ...] = BEND_ALIGNMENT
        elif isinstance(sensor, SectionPose):
            names = POSE_ALIGNMENT
        elif isinstance(sensor, Orientation):
            names = Orientation.parameter_names
        else:
            names = ()
        for name in names:
            full = f"{sensor.name}.{name}"
            unit = "m" if name.startswith("offset") else "rad"
            parameters.append(
                Parameter(full, "alignment", full, unit, values[full], float(ALIGNMENT_SPREAD[name]))
            )
    return parameters


def _with_mean_gains(
    specimen: Specimen, parameters: tuple[Parameter, ...], spread: float, stretch: StretchLaw | None
) -> Layout:
    """Add that the mean gain of each segment's chambers is known: it divides gains from the modulus."""
    rows, means = [], []
    for segment in specimen.segments:
        members = {str(chamber.index) for chamber in specimen.chambers if chamber.segment == segment.name}
        row = np.array([float(p.kind == "gain" and p.target in members) for p in parameters])
        if row.any():
            rows.append(row / row.sum())
            means.append(float(row @ [p.mean for p in parameters] / row.sum()))
    actuation = SpecimenSensors(specimen, (), Registration()).actuation()
    scales = {name: value.value for name, value in specimen.calibration.modulus_scale.items()}
    return Layout(
        parameters,
        Setting(scales, actuation, {}, stretch=stretch),
        np.array(rows).reshape(-1, len(parameters)),
        np.array(means),
        np.full(len(rows), spread),
    )
