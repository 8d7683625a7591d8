"""All sensors of an arm, any of which may be silent at an instant."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError, require_known
from softarm.estimator.model import Frames
from softarm.estimator.sensing.marker import MarkerPosition
from softarm.estimator.sensing.measurement import Measurement, Sensitivity, Unit, rigid_motion
from softarm.estimator.sensing.orientation import Orientation, orientations_kernel
from softarm.estimator.sensing.section_pose import MeasuredPose


@dataclass(frozen=True)
class Observation:
    """What the present sensors report at one instant, rows of absent ones left out.

    Args:
        innovation: Measured minus predicted, shape (rows,).
        twists: Derivative of the prediction by the stacked section twists, shape (rows, 6 sections).
        covariance: Covariance of the noise, shape (rows, rows).
        rows: Which rows of the whole suite these are, shape (rows,).
    """

    innovation: Floats
    twists: Floats
    covariance: Floats
    rows: NDArray[np.int64]


@dataclass(frozen=True)
class SensorSuite:
    """A mixture of measurements; readings are stacked into one vector, NaN where absent.

    Args:
        measurements: The sensors, each with a name of its own.

    Raises:
        InputError: If two sensors have one name.
    """

    measurements: tuple[Measurement, ...]

    def __post_init__(self) -> None:
        names = [measurement.name for measurement in self.measurements]
        for name in names:
            if names.count(name) > 1:
                raise InputError("sensors", f"{name!r} is named twice", "give each a name of its own")

    @cached_property
    def size(self) -> int:
        """Number of rows of the innovation."""
        return sum(measurement.size for measurement in self.measurements)

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """Rows of the innovation that belong to each sensor."""
        return self._slices([measurement.size for measurement in self.measurements])

    @cached_property
    def reading_slices(self) -> Mapping[str, slice]:
        """Entries of the stacked readings that belong to each sensor."""
        return self._slices([measurement.reading_size for measurement in self.measurements])

    def _slices(self, sizes: list[int]) -> Mapping[str, slice]:
        ends = np.cumsum([0, *sizes]).tolist()
        names = (measurement.name for measurement in self.measurements)
        return {name: slice(a, b) for name, a, b in zip(names, ends, ends[1:], strict=False)}

    @property
    def reading_size(self) -> int:
        """Number of entries of the stacked readings."""
        return sum(measurement.reading_size for measurement in self.measurements)

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each row of the innovation."""
        return tuple(unit for measurement in self.measurements for unit in measurement.units)

    @cached_property
    def noise(self) -> Floats:
        """Standard deviation of each row's own noise, at readings of zero, shape (size,)."""
        parts = [np.sqrt(np.diag(m.covariance(np.zeros(m.reading_size)))) for m in self.measurements]
        return np.concatenate(parts)

    def stack(self, readings: Mapping[str, Floats]) -> Floats:
        """Stack readings by sensor into one vector, shape (..., readings), NaN for those left out.

        Raises:
            InputError: If a name is unknown or a reading has a wrong size.
        """
        names = [measurement.name for measurement in self.measurements]
        for name in readings:
            require_known("readings", "sensor", name, names)
        leading = np.broadcast_shapes(*(np.shape(reading)[:-1] for reading in readings.values()))
        stacked = np.full((*leading, self.reading_size), np.nan)
        for measurement in self.measurements:
            reading = readings.get(measurement.name)
            if reading is None:
                continue
            size = np.shape(reading)[-1]
            if size != measurement.reading_size:
                what = f"{size} numbers instead of {measurement.reading_size}"
                raise InputError(f"reading {measurement.name}", what, "give all of them, NaN where lost")
            stacked[..., self.reading_slices[measurement.name]] = reading
        return stacked

    def predict(self, frames: Frames) -> Floats:
        """Return the stacked readings that the frames would cause, shape (..., readings)."""
        parts = [measurement.predict(frames) for measurement in self.measurements]
        return np.concatenate([*parts, np.zeros((*frames.positions.shape[:-2], 0))], axis=-1)

    def sensitivity(self, frames: Frames, readings: Floats) -> Sensitivity:
        """Compare stacked readings with the frames; rows of absent sensors have a NaN innovation."""
        # What a live estimator does many times per instant: one compiled call in place of one per sensor.
        if self._orientations is not None and readings.ndim == 1 and frames.rotations.ndim == 3:
            innovation, twists = np.empty(self.size), np.zeros((self.size, 6 * len(frames.rotations)))
            orientations_kernel(frames.rotations, *self._orientations, readings, innovation, twists)
            return Sensitivity(innovation, twists)
        parts = [
            measurement.sensitivity(frames, reading)
            for measurement, reading in zip(self.measurements, self._split(readings), strict=True)
        ]
        return Sensitivity(
            np.concatenate([part.innovation for part in parts], axis=-1),
            np.concatenate([part.twists for part in parts], axis=-2),
        )

    def covariance(self, frames: Frames, readings: Floats, twists: Floats) -> Floats:
        """Return the covariance of the noise of all rows, the registrations' errors included.

        An error of a registration moves all the readings that use it together. Moving the laboratory is
        moving the arm the other way, so its derivative follows from that by the section twists.

        Args:
            frames: The frames about which the noise is wanted.
            readings: Stacked readings, shape (..., readings).
            twists: Derivative by the section twists, shape (..., size, 6 sections).

        Returns:
            Shape (..., size, size).
        """
        covariance = self.sensor_noise(readings)
        for registration, members in self._registrations:
            moved = np.zeros((self.size, 1))
            for name in members:
                moved[self.slices[name]] = 1.0
            rigid = moved * (twists @ rigid_motion(frames))
            covariance += rigid @ registration @ np.swapaxes(rigid, -1, -2)
        return covariance

    def sensor_noise(self, readings: Floats) -> Floats:
        """Return the covariance of sensor noise, without that of registrations, shaped as ``covariance``.

        It depends on the readings alone.
        """
        covariance = np.zeros((*np.shape(readings)[:-1], self.size, self.size))
        for measurement, reading in zip(self.measurements, self._split(readings), strict=True):
            rows = self.slices[measurement.name]
            covariance[..., rows, rows] = measurement.covariance(reading)
        return covariance

    def observe(self, frames: Frames, readings: Floats, sensor_noise: Floats | None = None) -> Observation:
        """Compare the present readings of one instant, shape (readings,), with the frames.

        Args:
            frames: What they look at.
            readings: Stacked readings, shape (readings,).
            sensor_noise: The result of ``sensor_noise`` for them, where it is computed already.
        """
        whole = self.sensitivity(frames, readings)
        covariance = self.sensor_noise(readings) if sensor_noise is None else sensor_noise
        if self._registrations:
            covariance = self.covariance(frames, readings, np.nan_to_num(whole.twists))
        # One sum in place of a mask: at most instants every sensor is present.
        if math.isfinite(whole.innovation.sum()):
            return Observation(whole.innovation, whole.twists, covariance, self._every_row)
        rows = np.flatnonzero(np.isfinite(whole.innovation))
        return Observation(whole.innovation[rows], whole.twists[rows], covariance[rows][:, rows], rows)

    @cached_property
    def _every_row(self) -> NDArray[np.int64]:
        return np.arange(self.size)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all alignment parameters, ``<sensor>.<parameter>``."""
        return tuple(
            f"{measurement.name}.{name}"
            for measurement in self.measurements
            for name in measurement.parameter_names
        )

    @property
    def parameters(self) -> Floats:
        """Values of all alignment parameters."""
        return np.concatenate([measurement.parameters for measurement in self.measurements])

    def with_parameters(self, values: Floats) -> "SensorSuite":
        """Return the same sensors with other alignment parameters."""
        ends = np.cumsum([len(measurement.parameter_names) for measurement in self.measurements])
        parts = np.split(np.asarray(values, dtype=np.float64), ends[:-1])
        aligned = (m.with_parameters(part) for m, part in zip(self.measurements, parts, strict=True))
        return replace(self, measurements=tuple(aligned))

    @cached_property
    def base_recorded(self) -> bool:
        """Whether the recorded base determines where the laboratory is."""
        registrations = [m.registration for m in self.measurements if m.registration is not None]
        return any(not np.array_equal(one.rotation, np.eye(3)) for one in registrations)

    def moved(self, twist: Floats) -> "SensorSuite":
        """Move what the registrations map to by a twist (v [m], w [rad]), shape (6,)."""
        registrations = {id(m.registration): m.registration for m in self.measurements}
        moved = {key: one.moved(twist) for key, one in registrations.items() if one is not None}
        return replace(
            self,
            measurements=tuple(
                replace(m, registration=moved[id(m.registration)])
                if isinstance(m, MeasuredPose | Orientation | MarkerPosition)
                else m
                for m in self.measurements
            ),
        )

    def parameter_rows(self, frames: Frames, readings: Floats) -> Floats:
        """Return the derivative by all alignment parameters, shape (..., size, parameters)."""
        parts = [
            measurement.parameter_rows(frames, reading)
            for measurement, reading in zip(self.measurements, self._split(readings), strict=True)
        ]
        rows = np.zeros((*np.shape(readings)[:-1], self.size, len(self.parameter_names)))
        top = left = 0
        for part in parts:
            bottom, right = top + part.shape[-2], left + part.shape[-1]
            # A sensor's parameters change its own rows alone.
            rows[..., top:bottom, left:right] = part
            top, left = bottom, right
        return rows

    @cached_property
    def _orientations(self) -> tuple[NDArray[np.int64], Floats, Floats] | None:
        """Sections, mounting and laboratories of sensors that are all orientations; else None."""
        sensors = [m for m in self.measurements if isinstance(m, Orientation)]
        if not sensors or len(sensors) < len(self.measurements):
            return None
        sections = np.array([sensor.section for sensor in sensors])
        alignments, laboratories = zip(*(sensor.rotations for sensor in sensors), strict=True)
        return sections, np.array(alignments), np.array(laboratories)

    def _split(self, readings: Floats) -> list[Floats]:
        return [readings[..., entries] for entries in self.reading_slices.values()]

    @cached_property
    def _registrations(self) -> list[tuple[Floats, tuple[str, ...]]]:
        """Covariance of each uncertain registration with the sensors that use it."""
        # By identity: sensors share the error of a registration that they share.
        uncertain = {
            id(measurement.registration): measurement.registration
            for measurement in self.measurements
            if measurement.registration is not None and measurement.registration.covariance.any()
        }
        return [
            (
                registration.covariance,
                tuple(m.name for m in self.measurements if m.registration is registration),
            )
            for registration in uncertain.values()
        ]
