"""The unknowns of a calibration: each defines what its value changes in the model, and how readings follow.

With y the readings and x the stacked section twists, an unknown u that acts on the pressures P changes them
by dy/du = (dy/dx)(dx/dP)(dP/du); ``Prediction`` holds the first two factors.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.response import ArmResponse
from softarm.estimator.rotations import skew
from softarm.estimator.sensing import ActuationMap, MarkerPosition, MeasuredPose, SensorSuite
from softarm.estimator.sensing.measurement import rigid_motion

LOWEST_COMPLIANCE, HIGHEST_COMPLIANCE = -0.7, 4.0  # shares of the model's that a segment may have more
SINGLE_STEPS = "raise single chambers in steps over their whole range, each held for 5 s"


@dataclass(frozen=True)
class Prediction:
    """What a calibrated model predicts at many nodes, and how that changes.

    Args:
        setting: The calibration.
        suite: The sensors, aligned.
        response: The model's response.
        pressures: Recorded pressures [Pa], shape (nodes, chambers).
        loads: Known loads as recorded, shape (nodes, loads).
        gravity: As described [m/s2], shape (3,).
        readings: Stacked readings about which the sensors are differentiated, shape (nodes, readings).
        innovation: Measured minus predicted, NaN where absent, shape (nodes, rows).
        twists: Derivative of the prediction by the section twists, shape (nodes, rows, 6 sections).
    """

    setting: Setting
    suite: SensorSuite
    response: ArmResponse
    pressures: Floats
    loads: Floats
    gravity: Floats
    readings: Floats
    innovation: Floats
    twists: Floats

    @cached_property
    def pressure_jacobian(self) -> Floats:
        """Derivative by the pressures on unstretched chambers, shape (nodes, rows, chambers)."""
        return self.twists @ self.response.pressure_jacobian

    @cached_property
    def factor_jacobian(self) -> Floats:
        """Derivative by the logarithms of the stiffness factors, shape (nodes, rows, regions)."""
        return self.twists @ self.response.factor_jacobian

    @cached_property
    def eigenstrain_jacobian(self) -> Floats:
        """Derivative by the regions' eigenstrains, shape (nodes, rows, 4 regions)."""
        return self.twists @ self.response.eigenstrain_jacobian

    @cached_property
    def alignment_jacobian(self) -> Floats:
        """Derivative by the sensors' own parameters, shape (nodes, rows, parameters)."""
        return np.nan_to_num(self.suite.parameter_rows(self.response.frames, self.readings))

    @cached_property
    def rigid_jacobian(self) -> Floats:
        """Derivative by a rigid motion (v, w) of the whole arm, shape (nodes, rows, 6)."""
        rigid: Floats = self.twists @ rigid_motion(self.response.frames)
        return rigid

    @cached_property
    def base_jacobian(self) -> Floats:
        """Derivative by a motion of the base under the registered sensors, shape (nodes, rows, 6)."""
        moved = self.rigid_jacobian - lever(self.suite, np.nan_to_num(self.innovation))
        # Moving what the registered readings map to is moving their prediction the other way.
        base: Floats = -registered(self.suite)[:, None] * moved
        return base

    @cached_property
    def tilt_jacobian(self) -> Floats:
        """Derivative by the rotation of gravity about its two axes, shape (nodes, rows, 2)."""
        # d (exp(w) g) = w x g = -[g] w.
        tilts = -skew(self.setting.gravity(self.gravity)) @ self.setting.gravity_axes.T
        tilted: Floats = self.twists @ self.response.gravity_jacobian @ tilts
        return tilted

    @cached_property
    def azimuth_jacobian(self) -> Floats:
        """Derivative by a rotation of all pulls about z, shape (nodes, rows)."""
        return by_azimuth(self.twists @ self.response.load_jacobian, self.setting.pulls(self.loads))


@dataclass(frozen=True)
class Unknown(ABC):
    """One unknown of a calibration.

    Args:
        name: Such as ``modulus.upper``, ``gain.3``, ``bend_tip.in_plane``.
        unit: Its unit; a modulus is the logarithm of a factor.
        mean: Its value before any recording.
        spread: Standard deviation of that.
    """

    name: str
    unit: str
    mean: float
    spread: float

    manoeuvre: ClassVar[str]
    """What to record so that it can be determined."""

    @abstractmethod
    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting in which the unknown has a value."""

    @abstractmethod
    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings, shape (nodes, rows)."""


@dataclass(frozen=True)
class Modulus(Unknown):
    """Logarithm of a segment's stiffness factor.

    Args:
        segment: Name of the segment.
        index: Its number among the model's regions.
    """

    segment: str = ""
    index: int = 0

    manoeuvre = "hold the arm still at several pressures of its chambers between zero and their limit"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the segment's stiffness factor."""
        return replace(setting, scales={**setting.scales, self.segment: float(np.exp(value))})

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings, shape (nodes, rows)."""
        return at.factor_jacobian[..., self.index]


@dataclass(frozen=True)
class SegmentCompliance(Unknown):
    """Share of one of a segment's compliances that the model lacks.

    Args:
        segment: Name of the segment.
        index: Its number among the segments of the response.
    """

    segment: str = ""
    index: int = 0

    strain: ClassVar[int]
    """Generalised strain of the segment that grows with it; see ``ArmResponse``."""
    kind: ClassVar[str]
    """Name of the compliance in ``Setting``."""

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the segment's compliance."""
        bounded = float(np.clip(value, LOWEST_COMPLIANCE, HIGHEST_COMPLIANCE))
        changed: dict[str, Any] = {self.kind: {**getattr(setting, self.kind), self.segment: bounded}}
        return replace(setting, **changed)

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings: a softer segment strains further by its share."""
        strain = at.response.strains[:, self.index, self.strain]
        return at.eigenstrain_jacobian[..., 4 * self.index + self.strain] * strain[:, None]


@dataclass(frozen=True)
class Torsion(SegmentCompliance):
    """Share of a segment's torsional compliance that the model lacks."""

    manoeuvre = "record the poses of sections, yaw included, at pressures of single chambers"
    strain, kind = 2, "torsion"


@dataclass(frozen=True)
class Extension(SegmentCompliance):
    """Share of a segment's axial compliance that the model lacks."""

    manoeuvre = "record the positions of sections while all chambers of a segment are raised together"
    strain, kind = 3, "extension"


@dataclass(frozen=True)
class PressureUnknown(Unknown):
    """An unknown between the recorded pressures and those on the model's unstretched chambers."""

    @abstractmethod
    def change(self, at: Prediction) -> Floats:
        """Differentiate the pressures on unstretched chambers [Pa per unit], shape (nodes, chambers)."""

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings, shape (nodes, rows)."""
        slope: Floats = np.einsum("trc,tc->tr", at.pressure_jacobian, self.change(at))
        return slope


@dataclass(frozen=True)
class ChamberUnknown(PressureUnknown):
    """A coefficient of the map from recorded pressures, common to some chambers.

    Args:
        chambers: Indices of the chambers.
    """

    chambers: tuple[int, ...] = ()

    coefficient: ClassVar[str]
    """Name of the coefficient in ``ActuationMap``."""

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the coefficient."""
        actuation = setting.actuation
        array = np.array(np.broadcast_to(getattr(actuation, self.coefficient), len(actuation.gain)))
        array[list(self.chambers)] = value
        return replace(setting, actuation=_replaced(actuation, self.coefficient, array))

    def change(self, at: Prediction) -> Floats:
        """Differentiate the pressures; only those of its chambers change."""
        whole = self.slope(at.setting.actuation, at.pressures)
        change = np.zeros_like(at.pressures)
        change[:, list(self.chambers)] = whole[:, list(self.chambers)]
        return change

    @abstractmethod
    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:
        """Differentiate every chamber's pressure by its coefficient, shape (nodes, chambers)."""


@dataclass(frozen=True)
class Gain(ChamberUnknown):
    """Gain of a chamber at zero pressure."""

    manoeuvre = "raise this chamber alone in steps up to its limit, each held for 5 s"
    coefficient = "gain"

    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:
        """Differentiate by the gain."""
        return _at_unit_gain(actuation, measured)


@dataclass(frozen=True)
class Area(ChamberUnknown):
    """Logarithm of a factor on the gains of a segment's chambers: the area that the pressures push on."""

    manoeuvre = "turn the mount, or hang a known weight, and raise all chambers of the segment in turn"
    coefficient = "gain"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting in which the chambers' gains are multiplied."""
        gain = np.array(np.broadcast_to(setting.actuation.gain, len(setting.actuation.gain)))
        gain[list(self.chambers)] *= np.exp(value)
        return replace(setting, actuation=_replaced(setting.actuation, self.coefficient, gain))

    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:
        """Differentiate by the logarithm."""
        return np.asarray(actuation.gain * _at_unit_gain(actuation, measured))


@dataclass(frozen=True)
class Bias(ChamberUnknown):
    """Bias of a chamber's pressure."""

    manoeuvre = "hold zero pressure for 10 s, then raise this chamber alone in small steps"
    coefficient = "bias"

    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:  # noqa: ARG002
        """Differentiate by the bias."""
        return np.ones_like(measured)


@dataclass(frozen=True)
class LinearGrowth(ChamberUnknown):
    """Relative growth of the gains of a segment's chambers with the pressure."""

    manoeuvre = SINGLE_STEPS
    coefficient = "curve"

    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:
        """Differentiate by the growth."""
        return np.asarray(actuation.gain * measured**2)


@dataclass(frozen=True)
class QuadraticGrowth(ChamberUnknown):
    """Relative growth of the gains of a segment's chambers with the square of the pressure."""

    manoeuvre = SINGLE_STEPS
    coefficient = "quadratic_gain"

    def slope(self, actuation: ActuationMap, measured: Floats) -> Floats:
        """Differentiate by the growth."""
        return np.asarray(actuation.gain * measured**3)


@dataclass(frozen=True)
class Crosstalk(PressureUnknown):
    """Share of one chamber's pressure that acts in another.

    Args:
        acts_in: Index of the chamber that it acts in.
        comes_from: Index of the chamber whose pressure it is.
    """

    acts_in: int = 0
    comes_from: int = 0

    manoeuvre = "raise each chamber alone up to its limit, and hold random poses, all sections in view"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the share."""
        actuation = setting.actuation
        shares = np.array(np.broadcast_to(actuation.crosstalk, (len(actuation.gain),) * 2))
        shares[self.acts_in, self.comes_from] = value
        return replace(setting, actuation=_replaced(actuation, "crosstalk", shares))

    def change(self, at: Prediction) -> Floats:
        """Differentiate the pressures."""
        change = np.zeros_like(at.pressures)
        change[:, self.acts_in] = at.pressures[:, self.comes_from]
        return change


@dataclass(frozen=True)
class StretchGain(PressureUnknown):
    """Relative growth of the effective pressure per unit of its chamber's stretch."""

    manoeuvre = "pull on the vented arm and on the pressurised one, and hold random poses without"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the gain; a setting without a stretch law stays as it is."""
        law = setting.stretch
        return setting if law is None else replace(setting, stretch=replace(law, gain=value))

    def change(self, at: Prediction) -> Floats:
        """Differentiate the pressures: as if those on unstretched chambers had grown."""
        law = at.setting.stretch
        assert law is not None  # else it is no unknown
        stretches = law.stretches(at.response.frames)
        acting = at.setting.actuation.to_chamber(at.pressures)
        return np.asarray(acting * stretches / (1.0 + law.gain * stretches))


@dataclass(frozen=True)
class Alignment(Unknown):
    """A sensor's own parameter, ``<sensor>.<parameter>``."""

    manoeuvre = "bend the segment by more than 10 degrees in two directions, each held for 5 s"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the parameter."""
        return replace(setting, alignment={**setting.alignment, self.name: value})

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings; a suite without the sensor does not change."""
        if self.name not in at.suite.parameter_names:
            return np.zeros(at.twists.shape[:2])
        return at.alignment_jacobian[..., at.suite.parameter_names.index(self.name)]


@dataclass(frozen=True)
class VectorComponent(Unknown):
    """A component of a vector of the setting."""

    axis: int = 0

    vector: ClassVar[str]
    """Name of the vector in ``Setting``."""
    jacobian: ClassVar[str]
    """Name of the derivative by it in ``Prediction``, one column per component."""

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the component."""
        entered = getattr(setting, self.vector).copy()
        entered[self.axis] = value
        changed: dict[str, Any] = {self.vector: entered}
        return replace(setting, **changed)

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings, shape (nodes, rows)."""
        jacobian: Floats = getattr(at, self.jacobian)
        return jacobian[..., self.axis]


@dataclass(frozen=True)
class BaseMount(VectorComponent):
    """How the body on the base is mounted: shift along x, y, z [m], or rotation about them [rad]."""

    manoeuvre = "bend each segment by more than 20 degrees in three directions, each held for 5 s"
    vector, jacobian = "base", "base_jacobian"


@dataclass(frozen=True)
class GravityTilt(VectorComponent):
    """Rotation of gravity about one of the two axes across it [rad]."""

    manoeuvre = "hang a known weight, or pull with the gauge in three directions, each held for 5 s"
    vector, jacobian = "gravity_tilt", "tilt_jacobian"


@dataclass(frozen=True)
class CordAzimuth(Unknown):
    """Rotation of all known pulls about the base frame's z."""

    manoeuvre = "pull with the gauge by more than 0.2 N in two directions, the hook's marker in view"

    def apply(self, setting: Setting, value: float) -> Setting:
        """Return a setting with the rotation."""
        return replace(setting, cord_azimuth=value)

    def derivative(self, at: Prediction) -> Floats:
        """Differentiate the predicted readings, shape (nodes, rows)."""
        return at.azimuth_jacobian


def registered(suite: SensorSuite) -> Floats:
    """Return which rows of a suite rest on the laboratory's registration, 1 or 0, shape (rows,)."""
    flags = np.zeros(suite.size)
    for measurement in suite.measurements:
        flags[suite.slices[measurement.name]] = measurement.registration is not None
    return flags


def lever(suite: SensorSuite, innovation: Floats) -> Floats:
    """Compute how much further a rotation of the registration moves measured points than predicted ones.

    A rotation w moves a measured point y by w x y and a predicted one, p = y - innovation, by w x p.

    Returns:
        Per shift and rotation as ``rigid_motion`` has them, shape (nodes, rows, 6).
    """
    more = np.zeros((*innovation.shape, 6))
    for measurement in suite.measurements:
        if isinstance(measurement, MeasuredPose | MarkerPosition):
            first = suite.slices[measurement.name].start
            more[:, first : first + 3, 3:] = skew(innovation[:, first : first + 3])
    return more


def by_azimuth(load_jacobian: Floats, pulls: Floats) -> Floats:
    """Differentiate readings by a rotation of all pulls about z, shape (nodes, rows).

    Args:
        load_jacobian: Readings per unit of each load, shape (nodes, rows, loads).
        pulls: Forces, three components a section, shape (nodes, loads).
    """
    if not pulls.size:
        return np.zeros(load_jacobian.shape[:2])
    forces = pulls.reshape(len(pulls), -1, 3)
    change = np.cross([0.0, 0.0, 1.0], forces).reshape(pulls.shape)
    moved: Floats = (load_jacobian @ change[..., None])[..., 0]
    return moved


def _at_unit_gain(actuation: ActuationMap, measured: Floats) -> Floats:
    """Return the effective pressures at a gain of one [Pa], shape (nodes, chambers)."""
    return np.asarray(measured * (1.0 + (actuation.curve + actuation.quadratic_gain * measured) * measured))


def _replaced(actuation: ActuationMap, coefficient: str, value: Floats) -> ActuationMap:
    changed: dict[str, Any] = {coefficient: value}
    return replace(actuation, **changed)
