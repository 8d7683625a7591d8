"""One fake arm of a campaign: its recordings, its calibration, and each experiment on it."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from softarm.common.errors import WorkFailedError
from softarm.estimator.arm import default_loads
from softarm.estimator.calibration import (
    Calibrated,
    CalibrationRun,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
)
from softarm.estimator.calibration.pulls import section_forces
from softarm.estimator.errors import InputError
from softarm.estimator.files import write_whole
from softarm.estimator.recording import Recording
from softarm.estimator.response import BatchArmModel
from softarm.estimator.specimen import Specimen, load_specimen, save_specimen
from softarm.experiments.calibration_rows import comparison_rows, drift_rows, unknown_rows
from softarm.experiments.figures import Cells, Series
from softarm.experiments.force_rows import (
    SWINGING_HZ,
    PullCase,
    PullTrack,
    along_cord_row,
    axial_rows,
    follow_pull,
    location_rows,
)
from softarm.experiments.holds import hold_windows, means
from softarm.experiments.leave_one_out import leave_one_out_errors
from softarm.experiments.models import SharedSolutions, WarmModel, known_force_model
from softarm.experiments.paper import FORCE_N
from softarm.experiments.recorded import FakeRun, perform
from softarm.experiments.subsets import SUBSETS
from softarm.experiments.teaching import teach_recorded
from softarm.experiments.validation import pose_errors, rows
from softarm.recordings import load_recording
from softarm_client.errors import ClientError

CALIBRATION_RUNS = {
    "sweep": ("each_alone",),
    "poses": ("random_holds",),
    "pulls": ("pulled_steps",),
    "pulls_pressurised": ("pulled_taut_steps",),
}
RUNS: Mapping[str, tuple[str, ...]] = {
    **CALIBRATION_RUNS,
    "validation": ("random_holds", "random_holds"),
    "force_still": ("pulled_small_steps",),
    "force_pressurised": ("rest", "pulled_taut"),
    "force_moving": ("pulled_ramps",),
    "force_intermediate": ("pulled_small_steps_intermediate",),
    "taught": ("taught", "taught", "taught"),
    "taught_drawn": ("taught_drawn", "taught_drawn", "taught_drawn"),
    "force_swinging": ("plucked",),
}
"""Runs of the fake arm by name: manoeuvres of its library."""

HAND_MOTIONS = {"taught": "lateral", "taught_drawn": "lateral and axial"}
"""Direction in which the hand moves the arm, by the name of the run."""
REACHABLE = "both, reachable poses"
NODES = 84
FAILED = " failed: "


@dataclass(frozen=True)
class SeedPlan:
    """What is to be done on one arm.

    Args:
        number: Number of the seed; arms are drawn by it, 0 is the demo's, without tolerances.
        folder: Folder of the recordings and the calibrated specimen.
        experiments: ``calibrate``, ``validate``, ``force``, ``teach``.
        specimen: Nominal specimen.
        calibrated: A calibrated specimen to use instead of calibrating.
        nodes: Largest number of samples of the calibration.
        resume: Keep what an earlier run in the same folder has done.
    """

    number: int
    folder: Path
    experiments: tuple[str, ...]
    specimen: str = "sopra"
    calibrated: str | None = None
    nodes: int = NODES
    resume: bool = False


@dataclass
class SeedResult:
    """The results of one arm.

    Args:
        number: Number of the seed.
        tables: Rows by the name of the table.
        series: Columns of each plot by its name.
        notes: What a reader should know.
        failed: Experiments that did not come to an end; the notes state why.
        done: Experiments that did.
    """

    number: int
    tables: dict[str, list[Cells]] = field(default_factory=dict)
    series: dict[str, Series] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)

    def add(self, table: str, new: list[Cells]) -> None:
        """Add rows to a table, the seed before them."""
        self.tables.setdefault(table, []).extend({"seed": self.number} | row for row in new)


class SeedSetup:
    """The recordings and the calibration of one arm, made when they are first read."""

    def __init__(self, plan: SeedPlan) -> None:
        self.plan = plan
        self.nominal = load_specimen(plan.specimen)
        self._responses = SharedSolutions()

    @property
    def arm(self) -> int | None:
        """Which arm is drawn; ``None`` for the drawing itself, which is the demo's."""
        return self.plan.number or None

    def model(self, specimen: Specimen) -> BatchArmModel:
        """Return a model of the arm that begins at the responses of others."""
        return WarmModel(known_force_model(specimen), self._responses)

    def recording(self, name: str) -> Recording:
        """Return a recording by the name of its run."""
        number = list(RUNS).index(name)
        run = FakeRun(name, RUNS[name], seed=100 * self.plan.number + number, arm=self.arm)
        return load_recording(perform(run, self.plan.folder))

    def run(self, name: str, specimen: Specimen) -> CalibrationRun:
        """Return a recording arranged for a specimen, its gauge as known forces."""
        return arrange(self.recording(name), specimen, None, section_forces(specimen))

    @cached_property
    def found(self) -> Calibrated:
        """The joint calibration."""
        runs = [self.run(name, self.nominal) for name in CALIBRATION_RUNS]
        options = Options(nodes=self.plan.nodes, iterations=6)
        return calibrate(self.model(self.nominal), self.nominal, runs, options)

    @cached_property
    def specimen(self) -> Specimen:
        """The calibrated specimen; it is written beside the recordings."""
        if self.plan.calibrated is not None:
            return load_specimen(self.plan.calibrated)
        kept = self.plan.folder / "specimen.toml"
        if self.plan.resume and kept.exists():
            return load_specimen(str(kept))
        provenance = f"softarm experiment, fake arm {self.plan.number}, {', '.join(CALIBRATION_RUNS)}"
        specimen = calibrated_specimen(self.nominal, self.found, provenance)
        save_specimen(specimen, self.plan.folder / "specimen.toml")
        return specimen


def run_seed(plan: SeedPlan) -> SeedResult:
    """Do the experiments of one arm."""
    plan.folder.mkdir(parents=True, exist_ok=True)
    steps: dict[str, Callable[[SeedSetup, SeedResult], None]] = {
        "calibrate": _calibrate,
        "validate": _validate,
        "force": _force,
        "teach": _teach,
    }
    kept = plan.folder / "result.json"
    result = SeedResult(plan.number)
    if plan.resume and kept.exists():
        result = SeedResult(**json.loads(kept.read_text()))
        result.failed.clear()
        result.notes = [note for note in result.notes if FAILED not in note]
    setup = SeedSetup(plan)
    for name in plan.experiments:
        if name in result.done:
            continue
        try:
            steps[name](setup, result)
            result.done.append(name)
        except (ClientError, InputError, WorkFailedError) as error:  # one experiment fails, the others go on
            result.notes.append(f"{name}{FAILED}{error}")
            result.failed.append(name)
        write_whole({kept: json.dumps(asdict(result), indent=1, default=str).encode()})
    return result


def _calibrate(setup: SeedSetup, result: SeedResult) -> None:
    found = setup.found
    result.add("unknowns", unknown_rows(found))
    result.add("comparison", comparison_rows(setup.nominal, setup.specimen, setup.run, setup.model))
    result.add("drift", drift_rows(setup.specimen, setup.run, setup.model))


def _validate(setup: SeedSetup, result: SeedResult) -> None:
    specimen = setup.specimen
    recording = setup.recording("validation")
    holds = means(setup.run("validation", specimen), hold_windows(recording))
    solver = setup.model(specimen)
    errors = pose_errors(solver, specimen, holds)
    result.add("validation", rows(errors, "held out"))
    result.add("validation", rows(leave_one_out_errors(solver, specimen, holds), "leave one out"))
    last = errors[-1]
    result.series["validation"] = {"mm": last.millimetres.tolist(), "degrees": last.degrees.tolist()}


def _force(setup: SeedSetup, result: SeedResult) -> None:
    for condition, name in (("not pressurised", "force_still"), ("pressurised", "force_pressurised")):
        case = PullCase(condition, setup.recording(name), setup.specimen)
        resting = condition == "not pressurised"
        done = follow_pull(case, at_rest=resting)
        result.add("force", [along_cord_row(done, FORCE_N[condition])])
        result.series[f"force {condition}"] = series_of(done)
        for kind in SUBSETS:
            by = done if kind == "orientations" else follow_pull(case, kind, at_rest=resting)
            result.add("sensors", [along_cord_row(by)])
        result.add("axial", axial_rows(case, at_rest=resting))
        if resting:
            every = default_loads(setup.specimen)
            for kind in ("orientations", "poses"):
                by = follow_pull(case, kind, loads=every, at_rest=True)
                result.add("beyond", [along_cord_row(by)])
            result.add("location", location_rows(case))
    moving = PullCase("moving", setup.recording("force_moving"), setup.specimen)
    result.add("beyond", [along_cord_row(follow_pull(moving))])
    swinging = PullCase("swinging", setup.recording("force_swinging"), setup.specimen)
    done = follow_pull(swinging, rate=SWINGING_HZ, released=True)
    result.add("beyond", [along_cord_row(done)])
    above = PullCase("not pressurised", setup.recording("force_intermediate"), setup.specimen)
    result.add("beyond", [along_cord_row(follow_pull(above, at_rest=True))])
    result.add("location", location_rows(above))


def series_of(done: PullTrack) -> Series:
    """Return what a plot of the force needs; estimates that were lost are left out."""
    errors = done.errors.keep(np.isfinite(done.errors.estimate))
    return {
        "time_s": errors.time.tolist(),
        "gauge_n": errors.gauge.tolist(),
        "estimate_n": errors.estimate.tolist(),
        "std_n": errors.std.tolist(),
    }


def _teach(setup: SeedSetup, result: SeedResult) -> None:
    plan, results = setup.plan, []
    for name, motion in HAND_MOTIONS.items():
        done = teach_recorded(setup.recording(name), setup.specimen, plan.folder, setup.arm)
        results.append(done)
        result.add("teach", done.rows(motion))
        result.notes.append(done.note(motion))
    lateral, stretched = results
    both = lateral.joined(stretched)
    result.add("teach", both.rows(REACHABLE, both.near))
    result.series["teach"] = {
        f"{unit}_{attempt}": errors.tolist()
        for unit, sizes in (("mm", both.millimetres), ("degrees", both.degrees))
        for attempt, errors in enumerate(sizes)
    }
