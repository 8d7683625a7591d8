"""Rows of the force experiment: along the cord, by sensors, along the arm's axis, and where it acts."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import Track, Waypoints, track
from softarm.estimator.arm import default_loads
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration import CalibrationRun, arrange, section_forces
from softarm.estimator.fem import FiniteElementState
from softarm.estimator.inverse import ContactProfile
from softarm.estimator.model import Load
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import ModelError, widened
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import stretched
from softarm.experiments.figures import Cells, error_figures, inside, pull_figures, with_paper
from softarm.experiments.following import follow
from softarm.experiments.models import tracking_model, wrench_loads
from softarm.experiments.paper import Published
from softarm.experiments.pulls import (
    TAUT_N,
    ForceErrors,
    GaugePull,
    averaged_over,
    force_errors,
    pull_of,
    rest_windows,
)
from softarm.experiments.subsets import subset

RATE_HZ = 2.0
SWINGING_HZ = 50.0
"""Estimates per second of an arm that moves slowly, and of one that swings."""
VENTED_PA = 1.0e3
CANDIDATES = 14
LOCATED_SAMPLES = 6
"""Pulls that are located."""


@dataclass(frozen=True)
class PullTrack:
    """Estimates over a recording in which the cord pulls.

    Args:
        condition: ``not pressurised``, ``pressurised`` or another name.
        sensors: Which sensors it rests on.
        pull: What the gauge measures.
        track: The estimates.
        errors: Estimates beside the gauge while the cord is on.
    """

    condition: str
    sensors: str
    pull: GaugePull
    track: Track[Any]
    errors: ForceErrors


@dataclass(frozen=True)
class PullCase:
    """A recording of pulls on a specimen.

    Args:
        condition: Its name.
        recording: What was recorded.
        specimen: The calibrated robot.
        waypoints: States of its samples, once they have been estimated on some sensors.
    """

    condition: str
    recording: Recording
    specimen: Specimen
    waypoints: Waypoints[Any] = field(default_factory=Waypoints)

    def readings_and_pull(self, sensors: str, rate: float | None = None) -> tuple[CalibrationRun, GaugePull]:
        """Return the readings of some sensors and the gauge's pull, at a rate or at the end of each rest.

        Args:
            sensors: Which sensors are used; see ``subsets``.
            rate: Samples per second; None for one at the end of each rest of gauge and pressures.
        """
        run = arrange(self.recording, self.specimen, None, section_forces(self.specimen))
        sampled = averaged_over(run, rest_windows(self.recording)) if rate is None else resample(run, rate)
        chosen = subset(sampled, sensors)
        return chosen, pull_of(self.recording, self.specimen, chosen)


def follow_pull(
    case: PullCase,
    sensors: str = "orientations",
    loads: tuple[Load, ...] | None = None,
    rate: float = RATE_HZ,
    at_rest: bool = False,
    released: bool = False,
) -> PullTrack:
    """Estimate the force over a recording and compare it with the gauge.

    Args:
        case: Recording and specimen.
        sensors: Which sensors are used; see ``subsets``.
        loads: Unknown loads; two lateral forces on the pulled section where none are named.
        rate: Estimates per second.
        at_rest: Estimate once at the end of each rest of gauge and pressures instead.
        released: Also judge the time after the cord was let go, while the arm swings.
    """
    slow, pull = case.readings_and_pull(sensors, None if at_rest else rate)
    if released:
        pull = pull.released()
    model = tracking_model(
        case.specimen, default_loads(case.specimen, (pull.section,)) if loads is None else loads
    )
    tied = pull.tied
    vented = np.nan_to_num(slow.pressures).max(axis=1) < VENTED_PA
    untied = ~tied & vented
    tracked = track(model, case.specimen, slow, waypoints=case.waypoints, tared=untied)
    return PullTrack(case.condition, sensors, pull, tracked, force_errors(tracked, pull, untied).keep(tied))


def along_cord_row(done: PullTrack, published: Published | None = None) -> Cells:
    """Summarise the error along the cord, across the arm's axis; beside the paper's where there is one."""
    errors = done.errors
    row: Cells = {
        "condition": done.condition,
        "section": done.pull.section,
        "sensors": done.sensors,
        "unknown_loads": len(done.track.loads),
        "samples": len(errors.gauge),
        **pull_figures(errors.gauge, errors.error, errors.std),
    }
    if published is None:
        return row
    placed = with_paper(row, published, "n")
    percent = row["mean_percent"]
    aim = 100.0 * published.aim / published.span
    del placed["aim_n"]
    return placed | {
        "paper_mean_percent": 100.0 * published.mean / published.span,
        "aim_percent": aim,
        "aim_met": isinstance(percent, float) and percent <= aim,
    }


def axial_rows(case: PullCase, *, at_rest: bool = False) -> list[Cells]:
    """Estimate force along the arm's axis and torque about it from poses; the cord applies no torque."""
    slow, pull = case.readings_and_pull("poses", None if at_rest else RATE_HZ)
    model = tracking_model(case.specimen, wrench_loads(case.specimen, pull.section))
    tracked = track(model, case.specimen, slow, waypoints=case.waypoints)
    tied = pull.tied
    untied = ~tied & (slow.time < _first(slow.time, tied))
    names = [load.name for load in tracked.loads]
    rows = []
    truths = {"z": pull.force[:, 2], "torque": np.zeros(len(slow.time))}
    for name, truth in truths.items():
        index = names.index(f"{pull.section}_{name}")
        values = tracked.forces[:, index] - np.nanmean(tracked.forces[untied, index])
        error = (values - truth)[tied]
        unit = "mn_m" if name == "torque" else "n"
        factor = 1e3 if name == "torque" else 1.0
        figures = error_figures(factor * error, unit)
        rows.append(
            {
                "condition": case.condition,
                "quantity": "axial force" if name == "z" else "torque",
                "unit": "N" if name == "z" else "mN m",
                "samples": int(tied.sum()),
                **{key.removesuffix(f"_{unit}"): value for key, value in figures.items()},
                "std_of_estimate": float(np.nanmedian(factor * tracked.force_std[tied, index])),
                "inside_2_std": inside(error, tracked.force_std[tied, index]),
            }
        )
    return rows


def location_rows(case: PullCase) -> list[Cells]:
    """Find where along the arm the cord pulls, from poses, at the strongest steady pulls."""
    slow, pull = case.readings_and_pull("fused")
    strength = np.linalg.norm(pull.force, axis=1) * pull.tied
    strength[~np.isfinite(slow.readings).all(axis=1)] = 0.0
    chosen = [index for index in _strongest(strength, slow.time, LOCATED_SAMPLES) if strength[index] > TAUT_N]
    loads = default_loads(case.specimen, (pull.section,))
    low = min(segment.from_m for segment in case.specimen.segments)
    truth = case.specimen.section(pull.section).frame_origin_m[2]
    top = case.specimen.sections[-1].frame_origin_m[2]
    heights = np.linspace(low + 0.02, top, CANDIDATES)
    profile = ContactProfile(heights)
    suite = widened(slow.suite, ModelError.of(case.specimen.calibration.scatter).vented.scatter)
    model, pushed = (tracking_model(case.specimen, (*loads, *more)) for more in ((), profile.loads))
    moments = slow.time[sorted({0, *chosen})]
    errors: list[float] = []
    deviations: list[float] = []
    for estimate in follow(model, case.specimen, slow, moments, case.waypoints)[1:]:
        acting = np.concatenate([estimate.inputs.loads, np.zeros(len(profile.loads))])
        inputs = replace(estimate.inputs, loads=acting)
        index = len(errors)
        placed = profile.place(
            stretched(pushed, case.specimen),
            FiniteElementState(estimate.state.displacement, inputs),
            suite,
            slow.readings[sorted(chosen)[index]],
            estimate,
            np.zeros(len(loads)),
        )
        assert placed is not None  # two poses are twelve measurements
        errors.append(1e3 * (placed.height - truth))
        deviations.append(1e3 * placed.deviation)
    return [
        {
            "condition": case.condition,
            "section": pull.section,
            "height_mm": 1e3 * truth,
            "samples": len(errors),
            "mean_error_mm": float(np.mean(np.abs(errors))) if errors else None,
            "max_error_mm": float(np.max(np.abs(errors))) if errors else None,
            "std_of_estimate_mm": float(np.mean(deviations)) if errors else None,
            "inside_2_std": inside(np.array(errors), np.array(deviations)),
        }
    ]


def _strongest(strength: Floats, time: Floats, count: int) -> list[int]:
    """Choose the strongest moments, at least three seconds apart."""
    chosen: list[int] = []
    for index in np.argsort(-strength):
        if all(abs(time[index] - time[other]) > 3.0 for other in chosen):
            chosen.append(int(index))
        if len(chosen) == count:
            break
    return chosen


def _first(time: Floats, tied: Flags) -> float:
    return float(time[np.argmax(tied)]) if tied.any() else float(time[-1])
