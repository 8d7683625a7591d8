"""Estimated forces beside the gauge's, over a recording in which a cord pulls on the arm."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.analysis.offline.track import State, Track
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.pulls import cord_direction, gauged_section
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.series import runs
from softarm.estimator.specimen import Specimen
from softarm.experiments.holds import means

TAUT_N = 0.03
STILL_M_S = 1e-3
SETTLED_S = 0.6
WINDOW_S = 0.5
LEAVE_S = 0.2
"""End of a rest that is left out: a hook has moved for a while before it is seen to move."""


@dataclass(frozen=True)
class GaugePull:
    """The reading of the gauge over the times of an estimate.

    Args:
        section: Section that the cord is tied to.
        force: Mean force on it in the base frame [N], NaN without readings, shape (samples, 3).
        direction: Unit vector along the cord, zero while it is off, shape (samples, 3).
    """

    section: str
    force: Floats
    direction: Floats

    @property
    def tied(self) -> Flags:
        """Whether the cord is on, shape (samples,)."""
        on: Flags = np.linalg.norm(self.direction, axis=1) > 0.5
        return on

    @property
    def lateral(self) -> Floats:
        """Unit vectors of the cord across the arm's axis at the base, shape (samples, 3)."""
        across = self.direction * np.array([1.0, 1.0, 0.0])
        size = np.linalg.norm(across, axis=1, keepdims=True)
        return np.where(size > 0.1, across / np.maximum(size, 1e-9), 0.0)

    def released(self) -> "GaugePull":
        """Count the time after the cord was let go as well, in its last direction."""
        last = np.maximum.accumulate(np.where(self.tied, np.arange(len(self.direction)), 0))
        return replace(self, force=np.nan_to_num(self.force), direction=self.direction[last])


def pull_of(recording: Recording, specimen: Specimen, run: CalibrationRun) -> GaugePull:
    """Find the pull in a recording.

    Args:
        recording: What was recorded.
        specimen: The robot.
        run: The recording, arranged for ``section_forces`` and averaged over the looks or windows in which
            the pull is wanted.

    Raises:
        InputError: There is no gauge, its cord was slack throughout, or it reads nothing.
    """
    if not recording.gauges:
        raise InputError(recording.name, "has no force gauge", "record the gauge with the motion")
    gauge = recording.gauges[0]
    tension = recording.gauge(gauge)
    valid = np.isfinite(tension)
    if not valid.any():
        cure = "check its cable and its section in the configuration"
        raise InputError(f"{recording.name}, gauge {gauge}", "never answered", cure)
    if float(np.nanmax(tension)) < TAUT_N:
        raise InputError(
            f"{recording.name}, gauge {gauge}",
            f"pulls {float(np.nanmax(tension)):.3f} N at most: the cord was slack",
            "move the gauge away until the cord is taut, then in small steps",
        )
    sections = [name.rpartition("_")[0] for name in run.load_names]
    section = gauged_section(recording, gauge, sections)
    direction = cord_direction(recording, specimen, run.registration, section)
    if direction is None:
        raise InputError(
            recording.name, "does not state the direction of the cord", "add marker_hook_* or gauge_direction"
        )
    loads = run.loads.reshape(len(run.time), -1, 3)[:, sections[::3].index(section)]
    nearest = np.clip(np.searchsorted(recording.time, run.time), 0, len(recording.time) - 1)
    return GaugePull(section, loads, direction[nearest])


def rested(recording: Recording, times: Floats) -> Flags:
    """Return at which times hook and commanded pressures have not moved for ``SETTLED_S``.

    Commands may be recorded more seldom than the rest; a hook is not seen while the cord is off.
    """
    columns = [name for name in recording.columns if name.startswith(("marker_hook", "pressure_cmd"))]
    flags = np.zeros(len(times), dtype=bool)
    table = recording.stack(tuple(columns)) if columns else np.zeros((len(recording.time), 1))
    hooked = np.array(["hook" in name for name in columns] or [False])
    scale = np.array([2.0 * STILL_M_S * SETTLED_S if "hook" in name else 100.0 for name in columns] or [1.0])
    for index, moment in enumerate(times):
        inside = (recording.time > moment - SETTLED_S) & (recording.time <= moment)
        part = table[inside]
        if len(part) < 2:
            continue
        valid = np.isfinite(part)
        some = valid.any(axis=0)
        if (some != valid.all(axis=0))[hooked].any():  # tied or taken off meanwhile
            continue
        highest, lowest = (np.where(valid, part, -sign * np.inf).T for sign in (1.0, -1.0))
        spread = np.where(some, highest.max(axis=1) - lowest.min(axis=1), 0.0)
        flags[index] = bool((spread <= scale).all())
    return flags


def rest_windows(recording: Recording, window_s: float = WINDOW_S) -> Floats:
    """Find the end of each rest of hook and pressures, beginning and end of a window [s], shape (windows, 2).

    Looks end ``LEAVE_S`` before the rest does.
    """
    times = np.arange(recording.time[0], recording.time[-1], 0.1)
    still = rested(recording, times)
    ends = np.array([times[end - 1] for _, end in runs(still)]) - LEAVE_S
    return np.column_stack([ends - window_s, ends])


def averaged_over(run: CalibrationRun, windows: Floats) -> CalibrationRun:
    """Average a run over windows, so that each becomes one sample."""
    held = means(run, windows)
    return replace(held, time=held.time - 0.5 * WINDOW_S)


@dataclass(frozen=True)
class ForceErrors:
    """Estimated and measured force along the cord, across the arm's axis.

    Args:
        time: [s], shape (samples,).
        gauge: Lateral part of the pull [N], shape (samples,).
        estimate: Estimated force along it, less the tare [N], shape (samples,).
        std: Its standard deviation [N], shape (samples,).
    """

    time: Floats
    gauge: Floats
    estimate: Floats
    std: Floats

    @property
    def error(self) -> Floats:
        """Estimate less gauge [N], shape (samples,)."""
        return self.estimate - self.gauge

    def keep(self, flags: Flags) -> "ForceErrors":
        """Keep some samples, shape (samples,)."""
        return ForceErrors(self.time[flags], self.gauge[flags], self.estimate[flags], self.std[flags])


def force_errors(track: Track[State], pull: GaugePull, untied: Flags | None = None) -> ForceErrors:
    """Compare estimates with the gauge.

    Args:
        track: Estimates with lateral loads on the pulled section.
        pull: What the gauge measures at the same times.
        untied: Samples at which no force acts; each pull is tared by those just before it. None leaves the
            estimates as they are.
    """
    members = [index for index, load in enumerate(track.loads) if load.section == pull.section]
    axes = np.array([track.loads[index].direction for index in members])
    forces = track.forces[:, members] @ axes
    if untied is not None:
        forces = forces - tare(forces, untied)
    along = pull.lateral
    covariance = track.force_covariance[:, members][:, :, members]
    rows = np.einsum("si,li->sl", along, axes)
    variance = np.einsum("sl,slm,sm->s", rows, covariance, rows)
    return ForceErrors(
        track.run.time,
        np.einsum("si,si->s", pull.force, along),
        np.einsum("si,si->s", forces, along),
        np.sqrt(np.maximum(variance, 0.0)),
    )


def tare(forces: Floats, untied: Flags) -> Floats:
    """Return the mean force over the last stretch without force before each sample, shape (samples, axes).

    Args:
        forces: Estimates, shape (samples, axes).
        untied: Samples at which no force acts, shape (samples,).
    """
    zero = np.zeros_like(forces)
    start, now = 0, np.zeros(forces.shape[1])
    for index in range(len(forces)):
        if untied[index]:
            start = index if not (index and untied[index - 1]) else start
            before = forces[start : index + 1]
            now = np.nanmean(before, axis=0) if np.isfinite(before).all(axis=1).any() else now
        zero[index] = now
    return zero
