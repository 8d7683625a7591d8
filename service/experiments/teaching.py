"""Teach mode: poses shown by a hand, then held by pressures alone, and by how much they are missed."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.calibration import Run, arrange
from estimator.errors import InputError
from estimator.inverse import reach_pose
from estimator.model import ArmModel, Inputs
from estimator.recording import Recording
from estimator.rotations import from_quaternions, log
from estimator.sensing import SectionPose, SensorSuite
from estimator.specimen import Specimen
from service.experiments.figures import Cells, beside, error_figures, without_unit
from service.experiments.holds import hold_windows, means
from service.experiments.models import tracking_model
from service.experiments.paper import TEACH_DEGREES, TEACH_MM
from service.experiments.recorded import FakeRun, holds_table, perform
from service.offline.track import actuation
from service.recordings import load_recording

Floats = NDArray[np.float64]

POSITION_WEIGHT_M = 2e-3
ROTATION_WEIGHT_RAD = 0.025
"""A miss of one weighs as much as a miss of the other: the aims of the experiment."""
CORRECTIONS = 2
HOLD_S, RAMP_S = 4.0, 1.0
STILL_M_S = 0.01
SHORTEST_S = 2.0
LED_M = 0.01
FEWEST_POSES = 3


@dataclass(frozen=True)
class TaughtPoses:
    """What was shown.

    Args:
        suite: The tip's pose, with the weights of the search.
        readings: Poses shown, shape (poses, 7).
        time: When [s], shape (poses,).
    """

    suite: SensorSuite
    readings: Floats
    time: Floats


@dataclass
class TeachResult:
    """What came of it.

    Args:
        rows: Errors of position and orientation, before and after feedback.
        series: Errors pose by pose, for plots.
        notes: What a reader should know.
    """

    rows: list[Cells] = field(default_factory=list)
    series: dict[str, list[float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def taught_poses(recording: Recording, specimen: Specimen, section: str = "tip") -> TaughtPoses:
    """Find the poses at which a hand held the vented arm still.

    Raises:
        InputError: There are too few of them.
    """
    run = arrange(recording, specimen)
    sensor, readings = weighted_pose(run, section)
    windows = still_windows(run.time, readings[:, :3])
    held = means(replace(run, suite=SensorSuite((sensor,)), readings=readings), windows)
    rest = readings[np.isfinite(readings).all(axis=1)][0, :3]
    led = np.linalg.norm(held.readings[:, :3] - rest, axis=1) > LED_M
    held = held.keep(led)
    if len(held) < FEWEST_POSES:
        raise InputError(
            recording.name,
            f"shows {len(held)} poses held still for {SHORTEST_S:g} s",
            "lead the arm to a pose, hold it for 4 s, and go on to the next",
        )
    return TaughtPoses(SensorSuite((sensor,)), held.readings, held.time)


def weighted_pose(run: Run, section: str) -> tuple[SectionPose, Floats]:
    """Give a section's pose with the weights of the search, and its readings, shape (samples, 7).

    Raises:
        InputError: The recording has no such pose.
    """
    start = 0
    for sensor in run.suite.measurements:
        readings = run.readings[:, start : start + sensor.reading_size]
        start += sensor.reading_size
        if isinstance(sensor, SectionPose) and sensor.name == f"frame_{section}":
            weighted = replace(sensor, position_sigma=POSITION_WEIGHT_M, rotation_sigma=ROTATION_WEIGHT_RAD)
            return weighted, readings
    raise InputError(run.name, f"has no pose of {section}", "record its body")


def still_windows(time: Floats, positions: Floats, look: float = 0.5) -> Floats:
    """Find where a body rests, beginning and end of the look at each rest's end [s], shape (looks, 2)."""
    seen = np.isfinite(positions).all(axis=1)
    times, points = time[seen], positions[seen]
    width = max(2, round(0.2 / float(np.median(np.diff(times)))))
    kernel = np.ones(width) / width
    smooth = np.column_stack([np.convolve(column, kernel, mode="same") for column in points.T])
    speed = np.linalg.norm(np.gradient(smooth, times, axis=0), axis=1)
    speed[:width] = speed[-width:] = 0.0
    moving = speed > STILL_M_S
    edges = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(int)))
    windows = [
        (times[end - 1] - look, times[end - 1])
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        if times[end - 1] - times[start] >= SHORTEST_S
    ]
    return np.array(windows).reshape(-1, 2)


def holding_pressures(
    model: ArmModel[Any, Any], specimen: Specimen, poses: TaughtPoses, readings: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Find the chamber pressures that bring the free arm nearest to poses.

    Args:
        model: Model without loads.
        specimen: The calibrated robot.
        poses: Sensors and weights.
        readings: Poses, shape (poses, 7).

    Returns:
        Pressures [Pa], shape (poses, chambers), and whether each pose is reached within the weights.
    """
    limits = np.array(specimen.pressure_limits)
    gravity = np.array(specimen.gravity_m_s2)
    pressures, reached = np.zeros((len(readings), model.chambers)), np.zeros(len(readings), dtype=bool)
    inputs = Inputs(np.full(model.chambers, 5e3), np.zeros(len(model.loads)), gravity)
    start, _ = model.solve(inputs, model.rest())
    for index, reading in enumerate(readings):
        found = reach_pose(model, poses.suite, reading, limits, (start, inputs))
        pressures[index], reached[index] = found.pressures, found.reachable
    return pressures, reached


def teach_recorded(recording: Recording, specimen: Specimen, folder: Path, number: int | None) -> TeachResult:
    """Let the fake arm hold the poses that were shown, correct by what the model makes of the misses, repeat.

    The correction p += p(shown) - p(seen), both told in the model's pressures, is what the service's feedback
    settles at.

    Args:
        recording: The poses shown.
        specimen: The calibrated robot.
        folder: Folder of the recordings.
        number: Which arm is drawn.
    """
    poses = taught_poses(recording, specimen)
    model = tracking_model(specimen, ())
    mapping = actuation(specimen, arrange(recording, specimen))
    limits = np.array(specimen.pressure_limits)
    goal, reached = holding_pressures(model, specimen, poses, poses.readings)
    asked = goal.copy()
    result = TeachResult()
    for attempt in range(CORRECTIONS + 1):
        wanted = np.clip(mapping.to_measured(asked), 0.0, limits)
        table = holds_table(wanted, HOLD_S, RAMP_S)
        run = FakeRun(f"held_{attempt}", (), 7000 + attempt, number, table)
        seen = _held(load_recording(perform(run, folder)), specimen, len(goal))
        millimetres, degrees = misses(poses, seen)
        label = "pressures of the model" if attempt == 0 else f"after {attempt} corrections by feedback"
        result.rows += miss_rows(label, millimetres, degrees)
        result.series[f"mm_{attempt}"], result.series[f"degrees_{attempt}"] = (
            millimetres.tolist(),
            degrees.tolist(),
        )
        if attempt < CORRECTIONS:
            now, _ = holding_pressures(model, specimen, poses, seen)
            asked = np.clip(asked + goal - now, 0.0, limits)
    result.notes.append(
        f"{len(goal)} poses shown, {int(reached.sum())} of them reachable by pressures within "
        f"{1e3 * POSITION_WEIGHT_M:g} mm and {np.degrees(ROTATION_WEIGHT_RAD):.2g} degrees per axis."
    )
    return result


def _held(recording: Recording, specimen: Specimen, count: int) -> Floats:
    """Give the poses at the ends of the holds, the vented one left out, shape (poses, 7)."""
    run = arrange(recording, specimen)
    sensor, readings = weighted_pose(run, "tip")
    windows = hold_windows(recording, shortest=0.5 * HOLD_S)[-count:]
    return means(replace(run, suite=SensorSuite((sensor,)), readings=readings), windows).readings


def misses(poses: TaughtPoses, seen: Floats) -> tuple[Floats, Floats]:
    """Compare held with shown poses.

    Returns:
        Distances [mm] and angles [degrees], shape (poses,).
    """
    distance = 1e3 * np.linalg.norm(seen[:, :3] - poses.readings[:, :3], axis=1)
    shown, held = from_quaternions(poses.readings[:, 3:]), from_quaternions(seen[:, 3:])
    turn = log(np.swapaxes(shown, -1, -2) @ held)
    return distance, np.degrees(np.linalg.norm(turn, axis=1))


def miss_rows(label: str, millimetres: Floats, degrees: Floats) -> list[Cells]:
    """Give one row for the position and one for the orientation, beside the paper's."""
    rows: list[Cells] = []
    for quantity, unit, sizes, published in (
        ("position", "mm", millimetres, TEACH_MM),
        ("orientation", "degrees", degrees, TEACH_DEGREES),
    ):
        figures = without_unit(beside(error_figures(sizes, unit), published, unit), unit)
        rows.append({"run": label, "quantity": quantity, "unit": unit, "poses": len(sizes)} | figures)
    return rows
