"""The unknowns of a calibration for given recordings, and their prior."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.unknowns import (
    Alignment,
    Area,
    BaseMount,
    Bias,
    CordAzimuth,
    Crosstalk,
    Extension,
    Gain,
    GravityTilt,
    LinearGrowth,
    Modulus,
    Prediction,
    QuadraticGrowth,
    StretchGain,
    Torsion,
    Unknown,
)
from softarm.estimator.sensing import Bend, MeasuredPose, Measurement, Orientation, SensorSuite
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import StretchLaw

MODULUS_SPREAD = np.log(2.0)  # fitted shear moduli of such arms range from 35 to 152 kPa
DRAWN_SPREAD = np.log(5.0)  # of a drawing that nobody ever calibrated
GAIN_SPREAD = 0.15
MEAN_GAIN_SPREAD = 0.02  # a set of pressure sensors is right on average; divides gains from moduli
AREA_SPREAD = 0.3  # of the area that the pressures push on, where known pulls determine the moduli
CURVE_SPREAD = 5e-6  # 1/Pa; a winding may yield by a quarter over the working range
QUADRATIC_GAIN_SPREAD = 1e-10  # 1/Pa2; and its growth may change by as much again
CROSSTALK_SPREAD = 0.02  # chambers lie within a degree or two of their drawing
STRETCH_SPREAD = 1.0  # a chamber's area shrinks about as much as its length grows, or the winding keeps it
BIAS_SPREAD = 1.0e3  # Pa
NOMINAL_BIAS_SPREAD = 3.0e3  # Pa, where nobody measured the pressure
ROTATION_SPREAD = 0.03  # rad; the body on the base is mounted to two degrees
SHIFT_SPREAD = 1e-3  # m
GRAVITY_SPREAD = 0.01  # rad; a mount is levelled to half a degree
CORD_SPREAD = 0.1  # rad
TORSION_SPREAD = 0.5  # of the model's torsional compliance
EXTENSION_SPREAD = 0.5  # of the model's axial compliance
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
"""Prior standard deviation of each alignment parameter [rad or m]."""

BEND_ALIGNMENT = ("in_plane", "bias_x", "bias_y")
POSE_ALIGNMENT = MeasuredPose.parameter_names


@dataclass(frozen=True)
class Layout:
    """The unknowns in order, and the linear combinations that have a prior.

    Args:
        settled: What holds of all that is not among them.
        combinations: Rows over all unknowns whose sums have a prior, shape (combinations, unknowns).
        combination_means: Their prior means, shape (combinations,).
        combination_spreads: Standard deviations, shape (combinations,).
    """

    unknowns: tuple[Unknown, ...]
    settled: Setting
    combinations: Floats
    combination_means: Floats
    combination_spreads: Floats

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def means(self) -> Floats:
        """Prior means, shape (unknowns,)."""
        return np.array([unknown.mean for unknown in self.unknowns])

    @property
    def spreads(self) -> Floats:
        """Standard deviation of that, shape (unknowns,)."""
        return np.array([unknown.spread for unknown in self.unknowns])

    def setting(self, values: Floats) -> Setting:
        """Return what values of the unknowns stand for, shape (unknowns,)."""
        setting = self.settled
        for unknown, value in zip(self.unknowns, values.tolist(), strict=True):
            setting = unknown.apply(setting, value)
        return setting

    def jacobian(self, at: Prediction) -> Floats:
        """Differentiate predicted readings by the unknowns, shape (nodes, rows, unknowns)."""
        jacobian = np.zeros((*at.twists.shape[:2], len(self.unknowns)))
        for column, unknown in enumerate(self.unknowns):
            jacobian[..., column] = unknown.derivative(at)
        return jacobian

    def of(self, kind: type[Unknown]) -> Flags:
        """Return which unknowns are of a kind, shape (unknowns,)."""
        return np.array([isinstance(unknown, kind) for unknown in self.unknowns], dtype=bool)

    def without(self, names: Collection[str]) -> "Layout":
        """Settle some unknowns at their prior means."""
        out = np.array([name in names for name in self.names], dtype=bool)
        return Layout(
            tuple(p for p, settled in zip(self.unknowns, out, strict=True) if not settled),
            self.setting(self.means),
            self.combinations[:, ~out],
            self.combination_means - self.combinations[:, out] @ self.means[out],
            self.combination_spreads,
        )

    def extended(self, unknowns: Sequence[Unknown]) -> "Layout":
        """Add unknowns that no combination contains."""
        empty = np.zeros((len(self.combinations), len(unknowns)))
        return replace(
            self,
            unknowns=(*self.unknowns, *unknowns),
            combinations=np.hstack([self.combinations, empty]),
        )

    def prior_rows(self, values: Floats) -> tuple[Floats, Floats]:
        """Return the prior as whitened residuals and their derivative.

        Returns:
            (mean - value) / spread, shape (rows,), and the derivative of value / spread, (rows, unknowns).
        """
        innovation = (self.means - values) / self.spreads
        sums = (self.combination_means - self.combinations @ values) / self.combination_spreads
        rows = np.vstack([np.diag(1.0 / self.spreads), self.combinations / self.combination_spreads[:, None]])
        return np.concatenate([innovation, sums]), rows

    def prior_covariance(self) -> Floats:
        """Return the covariance of the prior, shape (unknowns, unknowns)."""
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
    compliant: Sequence[str] = (),
    drawn: bool = False,
) -> Layout:
    """Choose the unknowns that the recordings call for.

    Args:
        specimen: The robot, its present calibration being the prior.
        suite: The sensors.
        pressure_sources: ``measured``, ``commanded`` or ``none`` of each chamber.
        moved_chambers: Chambers whose pressure varied; the others keep their calibration.
        regions: Regions of the model whose stiffness can be scaled.
        pulled: Whether known forces are among the data: they determine the moduli, so that the area that the
            pressures push on need not be known.
        sections: Sections of the model, for what needs them: with known forces on an arm that has several
            chambers a segment, cross-talk, the quadratic growth of the gains and the effect of stretch on the
            effective pressures are among the unknowns. Left out, a calibrated effect of stretch is ignored.
        compliant: Segments whose torsional and axial compliance are open, in the order of the response.
        drawn: Whether the specimen is no more than a drawing: the area that pressures push on is open too.
    """
    unknowns = _moduli(specimen, regions, DRAWN_SPREAD if drawn else MODULUS_SPREAD)
    unknowns += _chambers(specimen, pressure_sources, moved_chambers, pulled)
    unknowns += _growths(specimen, moved_chambers)
    if drawn:
        unknowns += [
            Area(f"area.{segment}", "log factor", 0.0, AREA_SPREAD, chambers)
            for segment, chambers in _members(specimen, moved_chambers).items()
        ]
    if pulled and sections:
        unknowns += _finer(specimen, moved_chambers)
    unknowns += _alignment(suite)
    unknowns += _surroundings(suite, pulled)
    for index, name in enumerate(compliant):
        unknowns += [
            Torsion(f"torsion.{name}", "-", 0.0, TORSION_SPREAD, name, index),
            Extension(f"extension.{name}", "-", 0.0, EXTENSION_SPREAD, name, index),
        ]
    wanted = sections and (pulled or specimen.calibration.stretch_gain.value)
    stretch = StretchLaw.of(specimen, sections) if wanted else None
    spread = AREA_SPREAD if pulled else MEAN_GAIN_SPREAD
    return _with_mean_gains(specimen, tuple(unknowns), spread, stretch)


def _moduli(specimen: Specimen, regions: Sequence[str], spread: float) -> list[Unknown]:
    means = {s.name: float(np.log(specimen.calibration.scale(s.name))) for s in specimen.segments}
    return [
        Modulus(f"modulus.{name}", "log factor", mean, float(spread), name, regions.index(name))
        for name, mean in means.items()
        if name in regions
    ]


def _chambers(
    specimen: Specimen, sources: Sequence[str], moved: Sequence[int], pulled: bool
) -> list[Unknown]:
    gain_spread = float(np.hypot(GAIN_SPREAD, AREA_SPREAD)) if pulled else GAIN_SPREAD
    unknowns: list[Unknown] = []
    for k in moved:
        prior = specimen.calibration.chamber(k)
        bias_spread = BIAS_SPREAD if sources[k] == "measured" else NOMINAL_BIAS_SPREAD
        unknowns.append(Gain(f"gain.{k}", "-", prior.gain.value, gain_spread, (k,)))
        unknowns.append(Bias(f"bias.{k}", "Pa", prior.bias_pa.value, bias_spread, (k,)))
    return unknowns


def _members(specimen: Specimen, moved: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """Return the chambers of each segment whose pressure varied; segments without any are left out."""
    owners = {chamber.index: chamber.segment for chamber in specimen.chambers}
    members = {
        segment.name: tuple(k for k in moved if owners[k] == segment.name) for segment in specimen.segments
    }
    return {segment: chambers for segment, chambers in members.items() if chambers}


def _growths(specimen: Specimen, moved: Sequence[int]) -> list[Unknown]:
    """Let the gains of a segment's chambers grow with the pressure, all by the same share."""
    prior = specimen.calibration.chamber
    return [
        LinearGrowth(
            f"curve.{segment}",
            "1/Pa",
            float(np.mean([prior(k).curve_per_pa.value for k in chambers])),
            CURVE_SPREAD,
            chambers,
        )
        for segment, chambers in _members(specimen, moved).items()
    ]


def _finer(specimen: Specimen, moved: Sequence[int]) -> list[Unknown]:
    """List what only recordings of pulls and of pressures together can determine."""
    calibration = specimen.calibration
    unknowns: list[Unknown] = [StretchGain("stretch", "-", calibration.stretch_gain.value, STRETCH_SPREAD)]
    for segment, chambers in _members(specimen, moved).items():
        prior = float(np.mean([calibration.chamber(k).quadratic_gain_per_pa2.value for k in chambers]))
        unknowns.append(
            QuadraticGrowth(f"quadratic_gain.{segment}", "1/Pa2", prior, QUADRATIC_GAIN_SPREAD, chambers)
        )
    for row in (chamber.index for chamber in specimen.chambers):
        shares = calibration.chamber(row).crosstalk or (0.0,) * len(specimen.chambers)
        unknowns += [
            Crosstalk(f"crosstalk.{row}.{k}", "-", shares[k], CROSSTALK_SPREAD, row, k)
            for k in moved
            if k != row
        ]
    return unknowns


def _registered_by_body(sensor: Measurement) -> bool:
    """Return whether a sensor rests on the pose of one body; a fit to markers has an error of its own."""
    return sensor.registration is not None and not sensor.registration.covariance.any()


def _surroundings(suite: SensorSuite, pulled: bool) -> list[Unknown]:
    """Leave open how the base's body is mounted, where gravity points, and where the cord pulls."""
    unknowns: list[Unknown] = []
    if any(_registered_by_body(sensor) for sensor in suite.measurements):
        names = ("shift_x", "shift_y", "shift_z", "turn_x", "turn_y", "turn_z")
        for number, name in enumerate(names):
            unit, spread = ("m", SHIFT_SPREAD) if number < 3 else ("rad", ROTATION_SPREAD)
            unknowns.append(BaseMount(f"base.{name}", unit, 0.0, spread, number))
    for number, name in enumerate(("tilt_x", "tilt_y")):
        unknowns.append(GravityTilt(f"gravity.{name}", "rad", 0.0, GRAVITY_SPREAD, number))
    if pulled:
        unknowns.append(CordAzimuth("cord.azimuth", "rad", 0.0, CORD_SPREAD))
    return unknowns


def _alignment(suite: SensorSuite) -> list[Unknown]:
    unknowns: list[Unknown] = []
    values = dict(zip(suite.parameter_names, suite.parameters.tolist(), strict=True))
    for sensor in suite.measurements:
        if isinstance(sensor, Bend):
            names: tuple[str, ...] = BEND_ALIGNMENT
        elif isinstance(sensor, MeasuredPose):
            names = POSE_ALIGNMENT
        elif isinstance(sensor, Orientation):
            names = Orientation.parameter_names
        else:
            names = ()
        for name in names:
            full = f"{sensor.name}.{name}"
            unit = "m" if name.startswith("offset") else "rad"
            unknowns.append(Alignment(full, unit, values[full], float(ALIGNMENT_SPREAD[name])))
    return unknowns


def _with_mean_gains(
    specimen: Specimen, unknowns: tuple[Unknown, ...], spread: float, stretch: StretchLaw | None
) -> Layout:
    """Add a prior on the mean gain of each segment's chambers: it divides gains from the modulus."""
    rows, means = [], []
    for segment in specimen.segments:
        members = {(chamber.index,) for chamber in specimen.chambers if chamber.segment == segment.name}
        row = np.array([float(isinstance(u, Gain) and u.chambers in members) for u in unknowns])
        if row.any():
            rows.append(row / row.sum())
            means.append(float(row @ [u.mean for u in unknowns] / row.sum()))
    return Layout(
        unknowns,
        Setting.of(specimen, stretch),
        np.array(rows).reshape(-1, len(unknowns)),
        np.array(means),
        np.full(len(rows), spread),
    )
