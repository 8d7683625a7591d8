"""Teach mode: poses shown by a hand, then held by pressures alone, and by how much they are missed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import actuation
from softarm.common.errors import WorkFailedError
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration import CalibrationRun, arrange
from softarm.estimator.errors import InputError
from softarm.estimator.inverse import approach, replace_loads, settle
from softarm.estimator.model import Frames
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions, log
from softarm.estimator.sensing import MeasuredPose, SensorSuite
from softarm.estimator.series import runs
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import stretched
from softarm.experiments.figures import Cells, error_figures, with_paper, without_unit
from softarm.experiments.following import follow
from softarm.experiments.holds import hold_windows, means
from softarm.experiments.models import hand_loads, tracking_model
from softarm.experiments.paper import TEACH_DEGREES, TEACH_MM
from softarm.experiments.recorded import FakeRun, holds_table, perform
from softarm.experiments.subsets import subset
from softarm.recordings import load_recording

CORRECTIONS = 2
RATE_HZ = 1.0
HOLD_S, RAMP_S = 4.0, 1.0
STILL_M_S = 0.01
SHORTEST_S = 2.0
LED_M = 0.004
FEWEST_POSES = 3
VALVES_SEED = 7000
"""Draws the valves: every attempt is one of the same arm on the same terminal."""


@dataclass(frozen=True)
class TeachResult:
    """The misses of taught poses.

    Args:
        millimetres: Distances from the shown poses, before and after each correction, shape
            (attempts, poses).
        degrees: Angles, shape (attempts, poses).
        beyond: How far from each the nearest pose within reach is [mm, degrees], NaN where it was not found,
            shape (poses, 2).
        reachable: How many are within reach to within the sensors' noise.
    """

    millimetres: Floats
    degrees: Floats
    beyond: Floats
    reachable: int

    @property
    def near(self) -> Flags:
        """Whether pressures reach each pose to within the aims, by the model, shape (poses,)."""
        near: Flags = (self.beyond[:, 0] <= TEACH_MM.aim) & (self.beyond[:, 1] <= TEACH_DEGREES.aim)
        return near

    def rows(self, motion: str, which: Flags | None = None) -> list[Cells]:
        """Summarise each attempt, beside the paper and the mean distance of the nearest poses within reach.

        Args:
            motion: Direction in which the hand moved the arm.
            which: Poses that count, shape (poses,); all when left out.
        """
        taken = np.ones(len(self.beyond), dtype=bool) if which is None else which
        found = self.beyond[taken & np.isfinite(self.beyond).all(axis=1)]
        nearest = found.mean(axis=0).tolist() if len(found) else (None, None)
        rows: list[Cells] = []
        for attempt, (millimetres, degrees) in enumerate(zip(self.millimetres, self.degrees, strict=True)):
            label = "pressures of the model" if attempt == 0 else f"after {attempt} corrections by feedback"
            missed = miss_rows(label, millimetres[taken], degrees[taken]) if taken.any() else []
            for row, distance in zip(missed, nearest, strict=False):
                rows.append({"hand_motion": motion, **row, "nearest_in_reach": distance})
        return rows

    def joined(self, other: "TeachResult") -> "TeachResult":
        """Join the poses of two runs."""
        return TeachResult(
            np.hstack([self.millimetres, other.millimetres]),
            np.hstack([self.degrees, other.degrees]),
            np.vstack([self.beyond, other.beyond]),
            self.reachable + other.reachable,
        )

    def note(self, motion: str) -> str:
        """Return how far the nearest poses within reach are."""
        far = [f"{distance:.1f}" for distance in self.beyond[:, 0] if np.isfinite(distance)]
        return (
            f"{len(self.beyond)} poses with {motion} hand motion, of which {self.reachable} can be reached "
            "to within the sensors' noise; the nearest poses that pressures reach by the model are "
            f"{', '.join(far)} mm away."
        )


def taught_poses(recording: Recording, specimen: Specimen) -> CalibrationRun:
    """Return the poses of the tip at which a hand held the vented arm still, and when.

    Raises:
        InputError: There are too few of them.
    """
    run = pose_of(arrange(recording, specimen), "tip")
    held = means(run, still_windows(run.time, run.readings[:, :3]))
    rest = run.readings[np.isfinite(run.readings).all(axis=1)][0, :3]
    held = held.window(np.linalg.norm(held.readings[:, :3] - rest, axis=1) > LED_M)
    if len(held.time) < FEWEST_POSES:
        raise InputError(
            recording.name,
            f"shows {len(held.time)} poses held still for {SHORTEST_S:g} s",
            "guide the arm to a pose, hold it for 4 s, and go on to the next",
        )
    return held


def pose_of(run: CalibrationRun, section: str) -> CalibrationRun:
    """Return a run with the pose of one section alone, readings of shape (samples, 7).

    Raises:
        InputError: The recording has no such pose.
    """
    for sensor in run.suite.measurements:
        if isinstance(sensor, MeasuredPose) and sensor.name == f"frame_{section}":
            readings = run.readings[:, run.suite.reading_slices[sensor.name]]
            return replace(run, suite=SensorSuite((sensor,)), readings=readings)
    raise InputError(run.name, f"has no pose of {section}", "bring its markers into view, and record anew")


def still_windows(time: Floats, positions: Floats, window_s: float = 0.5) -> Floats:
    """Find where a body rests, beginning and end of the window at each rest's end [s], shape (windows, 2)."""
    valid = np.isfinite(positions).all(axis=1)
    times, points = time[valid], positions[valid]
    width = max(2, round(0.2 / float(np.median(np.diff(times)))))
    kernel = np.ones(width) / width
    smooth = np.column_stack([np.convolve(column, kernel, mode="same") for column in points.T])
    speed = np.linalg.norm(np.gradient(smooth, times, axis=0), axis=1)
    speed[:width] = speed[-width:] = 0.0
    windows = [
        (times[end - 1] - window_s, times[end - 1])
        for start, end in runs(speed <= STILL_M_S)
        if times[end - 1] - times[start] >= SHORTEST_S
    ]
    return np.array(windows).reshape(-1, 2)


def teach_recorded(recording: Recording, specimen: Specimen, folder: Path, number: int | None) -> TeachResult:
    """Hold the shown poses with the fake arm and correct the pressures by the misses, several times.

    The pressures and the corrections are those of the service: loads traded for pressures at the estimate of
    the shown pose, then a step towards it from the estimate of the held one; the service makes such steps
    little by little.

    Args:
        recording: The poses shown.
        specimen: The calibrated robot.
        folder: Folder of the recordings.
        number: Which arm is drawn.
    """
    poses = taught_poses(recording, specimen)
    model = tracking_model(specimen, hand_loads(specimen, "tip"))
    acting = stretched(model, specimen)
    mapping, limits = actuation(specimen, arrange(recording, specimen)), np.array(specimen.pressure_limits)
    shown = follow(model, specimen, _slow(recording, specimen), poses.time)
    tips = _as_shown(poses.suite, specimen)
    tare = np.zeros(len(model.loads))
    stills = [
        settle(acting, estimate, tips, limits, tare, replace_loads(estimate, tips, limits, tare))
        for estimate in shown
    ]
    nearest = [None if there is None else there.frames for _, there in stills]
    beyond = np.array([out_of_reach(goal.frames, there) for goal, there in zip(shown, nearest, strict=True)])
    held = [
        mapping.to_measured(e.inputs.pressures + step.change)
        for e, (step, _) in zip(shown, stills, strict=True)
    ]
    setpoints = np.clip(np.array(held), 0.0, limits)
    missed: list[tuple[Floats, Floats]] = []
    for attempt in range(CORRECTIONS + 1):
        run = FakeRun(
            f"{recording.name}_held_{attempt}",
            (),
            VALVES_SEED,
            number,
            holds_table(setpoints, HOLD_S, RAMP_S),
        )
        repeated = load_recording(perform(run, folder))
        windows = _held(repeated, specimen, len(setpoints))
        missed.append(misses(poses.readings, windows.readings))
        if attempt == CORRECTIONS:
            break
        for row, estimate, goal in zip(
            setpoints, follow(model, specimen, _slow(repeated, specimen), windows.time), shown, strict=True
        ):
            applied, now = mapping.to_measured(estimate.measured_pressures), estimate.inputs.pressures
            change = approach(estimate, tips, limits, goal.frames, applied, goal.residuals).change
            row += mapping.to_measured(now + change) - mapping.to_measured(now)
        setpoints = np.clip(setpoints, 0.0, limits)
    millimetres, degrees = (np.array(sizes) for sizes in zip(*missed, strict=True))
    return TeachResult(millimetres, degrees, beyond, sum(step.reachable for step, _ in stills))


def _as_shown(suite: SensorSuite, specimen: Specimen) -> SensorSuite:
    """Return the sensor of the shown poses with the specimen's noise as the tolerance of a held pose."""
    noise = specimen.noise
    return SensorSuite(
        tuple(
            replace(sensor, position_sigma=noise.position_m, rotation_sigma=noise.orientation_rad)
            for sensor in suite.measurements
            if isinstance(sensor, MeasuredPose)
        )
    )


def out_of_reach(goal: Frames, nearest: Frames | None) -> tuple[float, float]:
    """Return how far the last section is from a goal [mm, degrees] where pressures bring it nearest."""
    if nearest is None:
        return np.nan, np.nan
    distance = float(np.linalg.norm(nearest.positions[-1] - goal.positions[-1]))
    rotation = log(goal.rotations[-1].T @ nearest.rotations[-1])
    return 1e3 * distance, float(np.degrees(np.linalg.norm(rotation)))


def _slow(recording: Recording, specimen: Specimen) -> CalibrationRun:
    run = arrange(recording, specimen)
    return resample(subset(run, "poses"), RATE_HZ)


def _held(recording: Recording, specimen: Specimen, count: int) -> CalibrationRun:
    """Return the poses at the ends of the holds, the vented one left out."""
    windows = hold_windows(recording, shortest=0.5 * HOLD_S)
    if len(windows) not in (count, count + 1):  # the vented hold before them may be there or not
        raise WorkFailedError(f"{recording.name}: {len(windows)} holds for {count} poses")
    return means(pose_of(arrange(recording, specimen), "tip"), windows[-count:])


def misses(shown: Floats, held: Floats) -> tuple[Floats, Floats]:
    """Return distances [mm] and angles [degrees] of held from shown poses, shape (poses,) of (poses, 7)."""
    distance = 1e3 * np.linalg.norm(held[:, :3] - shown[:, :3], axis=1)
    rotation = log(np.swapaxes(from_quaternions(shown[:, 3:]), -1, -2) @ from_quaternions(held[:, 3:]))
    return distance, np.degrees(np.linalg.norm(rotation, axis=1))


def miss_rows(label: str, millimetres: Floats, degrees: Floats) -> list[Cells]:
    """Return one row for the position and one for the orientation, beside the paper's."""
    rows: list[Cells] = []
    for quantity, unit, sizes, published in (
        ("position", "mm", millimetres, TEACH_MM),
        ("orientation", "degrees", degrees, TEACH_DEGREES),
    ):
        figures = without_unit(with_paper(error_figures(sizes, unit), published, unit), unit)
        row: Cells = {"run": label, "quantity": quantity, "unit": unit, "poses": len(sizes)}
        rows.append(row | figures)
    return rows
