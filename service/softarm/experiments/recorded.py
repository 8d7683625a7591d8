"""Recorded runs: the fake arm goes through a manoeuvre faster than real time, in a process of its own."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from softarm.common.errors import WorkFailedError
from softarm.estimator.arrays import Floats

TIMEOUT_S = 600.0


@dataclass(frozen=True)
class FakeRun:
    """One run of the fake arm.

    Args:
        name: Of its folder.
        manoeuvres: Of the fake's library, one after another.
        seed: Of the manoeuvre's choices and of the noise.
        arm: Which arm is drawn (tolerances, misaligned frames, hysteresis); ``None`` for the drawing itself.
        commands: Pressures that are followed instead of manoeuvres: times [s], shape (points,), and pressures
            [Pa], shape (points, chambers).
    """

    name: str
    manoeuvres: tuple[str, ...]
    seed: int
    arm: int | None = None
    commands: tuple[Floats, Floats] | None = None


def perform(run: FakeRun, folder: Path) -> Path:
    """Simulate and record a run of the fake arm; a recording that exists already is kept.

    Returns:
        The recording.

    Raises:
        WorkFailedError: The fake arm failed.
    """
    recording = folder / run.name
    if (recording / "recording.csv").exists():
        return recording
    folder.mkdir(parents=True, exist_ok=True)
    words = [str(recording), "--seed", str(run.seed)]
    words += [word for name in run.manoeuvres for word in ("--manoeuvre", name)]
    if run.arm is not None:
        words += ["--variant", str(run.arm)]
    if run.commands is not None:
        words += ["--commands", str(write_commands(run, folder))]
    command = [sys.executable, "-m", "softarm.fakes.plant", "record", *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise WorkFailedError(f"the fake arm: no end after {TIMEOUT_S:g} s at {run.name}") from error
    if done.returncode:
        message = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise WorkFailedError(f"the fake arm: {message}")
    return recording


def write_commands(run: FakeRun, folder: Path) -> Path:
    """Write the table of pressures that a run follows."""
    assert run.commands is not None
    times, pressures = run.commands
    columns = {f"pressure_cmd_{k}_pa": column for k, column in enumerate(pressures.T)}
    path = folder / f"{run.name}_commands.csv"
    pl.DataFrame({"t_s": times, **columns}).write_csv(path)
    return path


def holds_table(levels: Floats, hold_s: float, ramp_s: float) -> tuple[Floats, Floats]:
    """Make a table that goes from level to level and holds each, beginning and ending vented.

    Args:
        levels: Pressures of each hold [Pa], shape (holds, chambers).
        hold_s: How long each is held.
        ramp_s: How long it takes to get there.
    """
    vented = np.zeros(levels.shape[1])
    times, points = [0.0, hold_s], [vented, vented]
    for level in levels:
        times += [times[-1] + ramp_s, times[-1] + ramp_s + hold_s]
        points += [level, level]
    return np.array(times), np.array(points)
