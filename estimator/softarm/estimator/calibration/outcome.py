"""The result of a calibration, and the specimen that contains it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.identifiability import Identified
from softarm.estimator.calibration.setting import gravity_axes
from softarm.estimator.calibration.unknowns import Modulus
from softarm.estimator.rotations import exp, from_quaternions, log
from softarm.estimator.specimen import BendCalibration, ChamberCalibration, FrameCalibration, Specimen, Value

ZERO = Value(value=0.0)
POSE_QUANTITIES = ("position",) * 3 + ("rotation",) * 2 + ("torsion",)
"""Quantity of each component of a pose."""


@dataclass(frozen=True)
class Check:
    """Root mean square of measured minus predicted at the nodes, by component of each sensor.

    Args:
        before: With the old calibration, on the nodes of ``held_out``, or of all where none are held out;
            empty where the model so calibrated has no equilibrium at the recorded pressures.
        training: On the nodes of the fit.
        held_out: On those held out of it; empty where there are none.
        line: Of the ordinary linear regression of the readings on the pressures, fitted on the training
            nodes, on those of ``held_out``; empty where it does not apply.
        line_parameters: Numbers that the regression fits.
    """

    before: Mapping[str, float]
    training: Mapping[str, float]
    held_out: Mapping[str, float]
    line: Mapping[str, float]
    line_parameters: int


@dataclass(frozen=True)
class Calibrated:
    """A calibration and how far to trust it.

    Args:
        identified: Every unknown with its value, deviation and verdict.
        covariance: Covariance of those that were fitted, in their order, shape (fitted, fitted).
        mirrored: Handedness of each bend by section.
        check: How well held-out nodes are predicted.
        lags: Seconds by which the motion lags the pressures in each run, ``None`` where undetermined.
        status: How the last fit ended.
        nodes: Number of nodes.
        recordings: Names of the runs.
        scatter: Root mean square of measured minus predicted, by sensor and quantity [m or rad], on held-out
            nodes.
        force_ratio: Error over deviation of the forces that follow from the readings at known pulls, each
            pull by the fit to all others, beside what grows with the pull; by condition and section.
        force_error: Relative error of forces, likewise.
        force_memory: Share of a force that the arm remembers once it is over, by section.
    """

    identified: tuple[Identified, ...]
    covariance: Floats
    mirrored: Mapping[str, bool]
    check: Check
    lags: tuple[float | None, ...]
    status: str
    nodes: int
    recordings: tuple[str, ...]
    scatter: Mapping[str, float]
    force_ratio: Mapping[str, float]
    force_error: Mapping[str, float]
    force_memory: Mapping[str, Value] = field(default_factory=dict)

    @property
    def fitted(self) -> int:
        """Number of unknowns that the data determine."""
        return sum(entry.verdict != "kept" for entry in self.identified)

    def value(self, name: str) -> Value | None:
        """Return a fitted unknown and its deviation; ``None`` where it was kept or is no unknown."""
        for entry in self.identified:
            if entry.unknown.name == name and entry.verdict != "kept":
                if isinstance(entry.unknown, Modulus):
                    factor = float(np.exp(entry.value))
                    return Value(value=factor, std=factor * entry.std)
                return Value(value=entry.value, std=entry.std)
        return None


def calibrated_specimen(specimen: Specimen, calibrated: Calibrated, provenance: str = "") -> Specimen:
    """Write a calibration into its specimen; what was kept stays as it was.

    Args:
        specimen: The specimen that was calibrated.
        calibrated: The calibration.
        provenance: When and how.
    """
    old = specimen.calibration
    scales = dict(old.modulus_scale)
    for segment in specimen.segments:
        scale = calibrated.value(f"modulus.{segment.name}")
        if scale is not None:
            scales[segment.name] = scale
    calibration = old.model_copy(
        update={
            "recordings": tuple(dict.fromkeys((*old.recordings, *calibrated.recordings))),
            "provenance": provenance or old.provenance,
            "scatter": dict(calibrated.scatter),
            "force_ratio": dict(calibrated.force_ratio),
            "force_error": dict(calibrated.force_error),
            "force_memory": dict(calibrated.force_memory),
            "modulus_scale": scales,
            "stretch_gain": calibrated.value("stretch") or old.stretch_gain,
            "chambers": tuple(_chamber(specimen, c.index, calibrated) for c in specimen.chambers),
            "bends": _bends(specimen, calibrated),
            "frames": _frames(specimen, calibrated),
        }
    )
    gravity = _gravity(specimen, calibrated)
    return specimen.model_copy(update={"calibration": calibration, "gravity_m_s2": gravity})


def by_quantity(components: Mapping[str, float]) -> dict[str, float]:
    """Join root mean squares of components to those of each sensor's quantities."""
    groups: dict[str, list[float]] = {}
    for name, value in components.items():
        groups.setdefault(quantity_of(name), []).append(value)
    return {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in groups.items()}


def quantity_of(component: str) -> str:
    """Name the sensor and quantity of a component: ``frame_tip.4`` is ``frame_tip rotation``.

    The rotation about the arm's axis is ``frame_tip torsion``: bending does not show how the arm twists.
    """
    sensor, _, number = component.rpartition(".")
    if not sensor.startswith("frame_"):
        return sensor
    return f"{sensor} {POSE_QUANTITIES[int(number)]}"


def _chamber(specimen: Specimen, index: int, calibrated: Calibrated) -> ChamberCalibration:
    old = specimen.calibration.chamber(index)
    segment = next(c.segment for c in specimen.chambers if c.index == index)
    gain, bias = calibrated.value(f"gain.{index}"), calibrated.value(f"bias.{index}")
    curve, quadratic = calibrated.value(f"curve.{segment}"), calibrated.value(f"quadratic_gain.{segment}")
    shares = [calibrated.value(f"crosstalk.{index}.{c.index}") or ZERO for c in specimen.chambers]
    crossed = any(share.value for share in shares)
    return ChamberCalibration(
        index=index,
        gain=gain or old.gain,
        bias_pa=bias or old.bias_pa,
        curve_per_pa=curve or old.curve_per_pa,
        quadratic_gain_per_pa2=quadratic or old.quadratic_gain_per_pa2,
        crosstalk=tuple(share.value for share in shares) if crossed else old.crosstalk,
        crosstalk_std=tuple(share.std for share in shares) if crossed else old.crosstalk_std,
    )


def _gravity(specimen: Specimen, calibrated: Calibrated) -> tuple[float, float, float]:
    """Tilt gravity as calibrated; a rotation about its own direction is unobservable."""
    gravity = np.array(specimen.gravity_m_s2)
    tilts = [calibrated.value(f"gravity.tilt_{axis}") for axis in "xy"]
    vector = np.array([0.0 if tilt is None else tilt.value for tilt in tilts])
    x, y, z = (exp(vector @ gravity_axes(gravity)) @ gravity).tolist()
    return x, y, z


def _bends(specimen: Specimen, calibrated: Calibrated) -> tuple[BendCalibration, ...]:
    entries = {entry.section: entry for entry in specimen.calibration.bends}
    for section, mirrored in calibrated.mirrored.items():
        old = specimen.calibration.bend(section)
        entries[section] = BendCalibration(
            section=section,
            rotation_rad=calibrated.value(f"bend_{section}.in_plane") or old.rotation_rad,
            mirrored=mirrored,
            bias_x_rad=calibrated.value(f"bend_{section}.bias_x") or old.bias_x_rad,
            bias_y_rad=calibrated.value(f"bend_{section}.bias_y") or old.bias_y_rad,
        )
    return tuple(entries.values())


def _frames(specimen: Specimen, calibrated: Calibrated) -> tuple[FrameCalibration, ...]:
    entries = {entry.section: entry for entry in specimen.calibration.frames}
    names = {entry.unknown.name for entry in calibrated.identified}
    for section in (section.name for section in specimen.sections):
        kinds = [kind for kind in ("frame", "orientation") if f"{kind}_{section}.misalignment_x" in names]
        if not kinds:
            continue
        old = specimen.calibration.frame(section)
        rotation = [calibrated.value(f"{kinds[0]}_{section}.misalignment_{axis}") for axis in "xyz"]
        moved = [calibrated.value(f"frame_{section}.offset_{axis}") for axis in "xyz"]
        entries[section] = FrameCalibration(
            section=section,
            misalignment_rad=_vector(rotation, old.misalignment_rad, "value"),
            misalignment_std_rad=_vector(rotation, old.misalignment_std_rad, "std"),
            offset_m=_vector(moved, old.offset_m, "value"),
            offset_std_m=_vector(moved, old.offset_std_m, "std"),
        )
    mounted = _mounted(specimen, calibrated)
    if mounted is not None:
        entries[mounted.section] = mounted
    return tuple(entries.values())


def _mounted(specimen: Specimen, calibrated: Calibrated) -> FrameCalibration | None:
    """Return how the body on the base is mounted; it adds to the earlier registration."""
    rotation = [calibrated.value(f"base.turn_{axis}") for axis in "xyz"]
    moved = [calibrated.value(f"base.shift_{axis}") for axis in "xyz"]
    if all(value is None for value in (*rotation, *moved)):
        return None
    section = specimen.sections[0]
    old = specimen.calibration.frame(section.name)
    rest = from_quaternions(np.array(section.frame_quaternion))
    rotation_vector, shift = (
        np.array(_vector(rotation, (0, 0, 0), "value")),
        np.array(_vector(moved, (0, 0, 0), "value")),
    )
    origin = np.array(section.frame_origin_m)
    before = origin + rest @ np.array(old.offset_m)
    offset = rest.T @ (exp(rotation_vector) @ before + shift - origin)
    misalignment = log(rest.T @ exp(rotation_vector) @ rest @ exp(np.array(old.misalignment_rad)))
    return FrameCalibration(
        section=section.name,
        misalignment_rad=tuple(misalignment.tolist()),
        misalignment_std_rad=_vector(rotation, old.misalignment_std_rad, "std"),
        offset_m=tuple(offset.tolist()),
        offset_std_m=_vector(moved, old.offset_std_m, "std"),
    )


def _vector(
    values: list[Value | None], old: tuple[float, float, float], field: str
) -> tuple[float, float, float]:
    x, y, z = (
        kept if value is None else float(getattr(value, field))
        for value, kept in zip(values, old, strict=True)
    )
    return x, y, z
