"""Simulated readings: from the true motion of a run to columns with the noise of real recordings.

Noise of the recorded data: bends of motion capture 0.02 to 0.05 degrees from sample to sample, markers 5 to
20 micrometres, gaps up to 0.14 s; a gauge reads in steps of one gram; a valve terminal in steps of 1 mbar.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects import Concealed, Filter, filters
from softarm.fakes.plant.manoeuvre import SAMPLE
from softarm.fakes.plant.rotations import product, rotation_matrix, tilt, vector_quaternion
from softarm.fakes.plant.run import Truth

Random = np.random.Generator

GRAM = 9.81e-3
MILLIBAR = 100.0
PRESSURE_NOISE = 30.0
STRIP_DEAD_ZONE = np.radians(0.5)
MARKERS = {
    "base": ((0.045, 0.0, 0.0), (-0.0225, 0.039, 0.004), (-0.0225, -0.039, -0.003)),
    "intermediate": ((0.040, 0.004, 0.0), (-0.021, 0.034, 0.003), (-0.019, -0.035, -0.004)),
    "tip": ((0.032, 0.0, 0.003), (-0.017, 0.027, -0.002), (-0.015, -0.029, 0.0)),
}


@dataclass(frozen=True)
class InstrumentQuality:
    """How well the laboratory measures.

    Args:
        angle_noise: Of an orientation from sample to sample, per axis [rad].
        angle_wander: Of an orientation over ``wander_time``, per axis [rad].
        position_noise: From sample to sample [m].
        position_wander: Over ``wander_time`` [m].
        wander_time: Correlation time [s].
        marker_noise: Of one marker [m].
        losses: Gaps of the motion capture per second and body.
        longest_loss: Longest gap [s].
        offset: Delay of the motion capture's clock behind that of the valves [s].
        gauge_noise: [N].
        gauge_rate: Readings per second.
        strip_noise: Of a bend sensor [rad].
        alignments: Rotation of each body's frame against its section [rad], shape (sections, 3); none when
            empty.
        pressure_tap: Where the pressure is measured: ``valve`` or ``chamber``.
    """

    angle_noise: float = np.radians(0.025)
    angle_wander: float = np.radians(0.02)
    position_noise: float = 15e-6
    position_wander: float = 15e-6
    wander_time: float = 3.0
    marker_noise: float = 12e-6
    losses: float = 0.02
    longest_loss: float = 0.14
    offset: float = 0.0
    gauge_noise: float = 4e-3
    gauge_rate: float = 20.0
    strip_noise: float = np.radians(0.12)
    alignments: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    pressure_tap: str = "valve"


@dataclass(frozen=True)
class Streams:
    """What a recording contains: groups of columns.

    Args:
        commanded: Commanded pressures.
        measured: Measured pressures.
        frames: Sections whose pose is recorded; all when left out.
        bends: Source of the bends: ``mocap``, ``strips`` or ``none``.
        gauge: The force gauge, and its hook as a marker.
        markers: Markers of the sections.
    """

    commanded: bool = True
    measured: bool = True
    frames: tuple[str, ...] | None = None
    bends: str = "mocap"
    gauge: bool = True
    markers: bool = False


def observe(
    truth: Truth,
    commands: Floats,
    sections: tuple[str, ...],
    concealed: tuple[Concealed, ...],
    instruments: InstrumentQuality,
    streams: Streams,
    rng: Random,
) -> dict[str, Floats]:
    """Return a run as measured: canonical columns, each of shape (samples,); NaN where a reading was lost.

    Args:
        truth: What really happened.
        commands: Set-points of the chambers, gauge [Pa], shape (samples, chambers).
        sections: Names of the sections.
        concealed: Hidden effects; those of instruments act here.
        instruments: Noise, wander and losses.
        streams: What is recorded.
        rng: Draws the noise.
    """
    columns: dict[str, Floats] = {}
    if streams.commanded:
        columns |= _pressures("pressure_cmd_{}_pa", commands)
    if streams.measured:
        columns |= _pressures("pressure_{}_pa", _measured(truth, concealed, instruments, rng))
    poses = _measured_poses(truth, sections, concealed, instruments, rng)
    for number, section in enumerate(sections):
        if streams.frames is None or section in streams.frames:
            columns |= _frame(section, poses[:, number])
        if streams.markers and section in MARKERS:
            columns |= _markers(section, poses[:, number], instruments, rng)
    if streams.bends != "none":
        columns |= _bends(truth, poses, sections, concealed, instruments, streams, rng)
    if streams.gauge:
        columns |= _gauge(truth, concealed, instruments, rng)
    return columns


def bends_of(quaternions: Floats) -> Floats:
    """Return the tilt of each section in the one above [rad], shape (samples, segments, 2)."""
    matrices = rotation_matrix(quaternions)
    return tilt(np.einsum("tsji,tsj->tsi", matrices[:, :-1], matrices[:, 1:, :, 2]))


def _measured(
    truth: Truth, concealed: tuple[Concealed, ...], instruments: InstrumentQuality, rng: Random
) -> Floats:
    """Return the pressures as the terminal, or sensors in the chambers, report them [Pa]."""
    if instruments.pressure_tap == "chamber":
        source = truth.chambers
    else:
        source = _filtered(truth.time, truth.outlets, filters(concealed, "pressure"))
    return _rounded(source + rng.normal(0.0, PRESSURE_NOISE, source.shape), MILLIBAR)


def _measured_poses(
    truth: Truth,
    sections: tuple[str, ...],
    concealed: tuple[Concealed, ...],
    instruments: InstrumentQuality,
    rng: Random,
) -> Floats:
    """Return the poses as the motion capture saw them, shape (samples, sections, 7)."""
    poses = _delayed(truth.poses, instruments.offset)
    for number, section in enumerate(sections):
        body = poses[:, number]
        if len(instruments.alignments):
            body[:, 3:] = product(body[:, 3:], vector_quaternion(instruments.alignments[number]))
        body[:] = _filtered(truth.time, body, filters(concealed, "pose", f"frame_{section}"))
        count = len(body)
        body[:, :3] += rng.normal(0.0, instruments.position_noise, (count, 3))
        body[:, :3] += _wander(rng, count, 3, instruments.position_wander, instruments.wander_time)
        rotation = rng.normal(0.0, instruments.angle_noise, (count, 3))
        rotation += _wander(rng, count, 3, instruments.angle_wander, instruments.wander_time)
        body[:, 3:] = _normalised(product(body[:, 3:], np.column_stack([np.ones(count), 0.5 * rotation])))
        body[_lost(rng, count, instruments)] = np.nan
    return poses


def _delayed(poses: Floats, offset: float) -> Floats:
    """Shift the poses in time by linear interpolation, held at the ends."""
    clock = np.clip(np.arange(len(poses)) - offset / SAMPLE, 0.0, len(poses) - 1.0)
    below = np.minimum(clock.astype(int), len(poses) - 2)
    share = (clock - below)[:, None, None]
    shifted = (1.0 - share) * poses[below] + share * poses[below + 1]
    shifted[..., 3:] = _normalised(shifted[..., 3:])
    return np.asarray(shifted)


def _normalised(quaternions: Floats) -> Floats:
    """Scale quaternions to unit length."""
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))


def _filtered(time: Floats, values: Floats, chain: tuple[Filter, ...]) -> Floats:
    """Pass readings of shape (samples, components) through filters."""
    for one in chain:
        values = np.array(
            [one.update(float(moment), value) for moment, value in zip(time, values, strict=True)]
        )
    return values


def _wander(rng: Random, count: int, width: int, size: float, time: float) -> Floats:
    """Draw a slow error of standard deviation ``size``, a first-order process, shape (count, width)."""
    keep = float(np.exp(-SAMPLE / time))
    kicks = rng.normal(0.0, size * np.sqrt(1.0 - keep * keep), (count, width))
    error, errors = rng.normal(0.0, size, width), np.empty((count, width))
    for k in range(count):
        errors[k] = error = keep * error + kicks[k]
    return errors


def _lost(rng: Random, count: int, instruments: InstrumentQuality) -> NDArray[np.bool_]:
    """Draw the samples at which a body was lost."""
    lost = np.zeros(count, dtype=bool)
    for start in np.flatnonzero(rng.random(count) < instruments.losses * SAMPLE):
        lost[start : start + int(rng.integers(1, round(instruments.longest_loss / SAMPLE) + 1))] = True
    return lost


def _pressures(pattern: str, values: Floats) -> dict[str, Floats]:
    """Name the columns of pressures."""
    return {pattern.format(chamber): column for chamber, column in enumerate(values.T)}


def _rounded(values: Floats, step: float) -> Floats:
    """Round to the resolution of an instrument."""
    return np.asarray(np.round(values / step) * step)


def _frame(section: str, poses: Floats) -> dict[str, Floats]:
    """Name the columns of a pose."""
    names = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
    return {f"frame_{section}_{name}": column for name, column in zip(names, poses.T, strict=True)}


def _markers(section: str, poses: Floats, instruments: InstrumentQuality, rng: Random) -> dict[str, Floats]:
    """Place the markers of a section in the laboratory."""
    matrices = rotation_matrix(poses[:, 3:])
    columns: dict[str, Floats] = {}
    for number, place in enumerate(MARKERS[section], start=1):
        points = poses[:, :3] + matrices @ np.array(place)
        points = points + rng.normal(0.0, instruments.marker_noise, points.shape)
        for axis, column in zip("xyz", points.T, strict=True):
            columns[f"marker_{section}{number}_{axis}_m"] = column
    return columns


def _bends(
    truth: Truth,
    poses: Floats,
    sections: tuple[str, ...],
    concealed: tuple[Concealed, ...],
    instruments: InstrumentQuality,
    streams: Streams,
    rng: Random,
) -> dict[str, Floats]:
    """Return the bends: from measured poses, or from strips, which repeat a value within half a degree."""
    strips = streams.bends == "strips"
    bends = bends_of(truth.poses[..., 3:] if strips else poses[..., 3:])
    columns: dict[str, Floats] = {}
    for number, section in enumerate(sections[1:]):
        sensor = f"bend_{section}"
        acting = tuple(one for one in concealed if strips or one.where.get("sensor") == sensor)
        values = _filtered(truth.time, bends[:, number], filters(acting, "bend", sensor))
        if strips:
            values = _repeated(
                values + rng.normal(0.0, instruments.strip_noise, values.shape), STRIP_DEAD_ZONE
            )
        columns |= {f"{sensor}_x_rad": values[:, 0], f"{sensor}_y_rad": values[:, 1]}
    return columns


def _repeated(values: Floats, zone: float) -> Floats:
    """Repeat the last value of each axis until it has moved by more than ``zone``."""
    out, now = values.copy(), values[0].copy()
    for index, value in enumerate(values):
        now = np.where(np.abs(value - now) > zone, value, now)
        out[index] = now
    return out


def _gauge(
    truth: Truth, concealed: tuple[Concealed, ...], instruments: InstrumentQuality, rng: Random
) -> dict[str, Floats]:
    """Return the readings of the gauge, in whole grams at its own rate, and its hook as a marker."""
    pull = truth.cord_force + rng.normal(0.0, instruments.gauge_noise, len(truth.cord_force))
    pull = _filtered(truth.time, pull[:, None], filters(concealed, "gauge", "gauge_cord"))[:, 0]
    pull = _rounded(pull, GRAM)
    every = max(1, round(1.0 / (instruments.gauge_rate * SAMPLE)))
    pull[np.arange(len(pull)) % every != 0] = np.nan
    hook = truth.hook + rng.normal(0.0, instruments.marker_noise, truth.hook.shape)
    return {"gauge_cord_n": pull} | {
        f"marker_hook_{axis}_m": column for axis, column in zip("xyz", hook.T, strict=True)
    }
