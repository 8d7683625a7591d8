"""``softarm bench real-data``: calibrate on real recordings, predict what was left out of the fit."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from acceptance.real_diagnoses import (
    ARM,
    BARE,
    LOADED,
    arm_diagnoses,
    diagnosed_beam,
    diagnosed_valves,
    weight,
)
from softarm.analysis.offline.alignment import quick_model
from softarm.analysis.offline.inputs import cut, load_recordings
from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import track
from softarm.cli.output import PATH, json_option, notify, progress, quick_option, show
from softarm.common.tables import Cell, Table, as_markdown
from softarm.estimator.arm import build_arm
from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration import (
    Calibrated,
    CalibrationRefusedError,
    CalibrationRun,
    Options,
    arrange,
    calibrate,
    calibrated_specimen,
)
from softarm.estimator.calibration.nodes import block_of, training_blocks
from softarm.estimator.calibration.regression import fit_line
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.unknowns import Modulus
from softarm.estimator.errors import InputError
from softarm.estimator.model import Inputs
from softarm.estimator.recording import Recording
from softarm.estimator.response import BatchArmModel, BatchInputs
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.specimen import Calibration, Specimen, load_specimen
from softarm.estimator.stretch import StretchLaw

BESIDE = Path(__file__).parents[3] / "shared" / "recordings"
HELD = (0.15, 0.6)  # s, while the beam is held level
SEGMENT, STEPS = "single_segment_blackframe", (75, 125, 175, 225, 275, 325, 375)
LINEAR_SOLVES, SEGMENT_SECONDS = 40, 200.0
SETTLED_STEP = 0.1  # s before the end of a step; one sample of the calibration
RATE = 10.0  # Hz of the predictions
CHECK_RATE = 0.5  # Hz of those on the finite elements
"""Recordings and the parts of them that count."""
PAGE = """# Real recordings

Written by `softarm bench real-data --write docs/real-data.md`: softarm is calibrated on silicone robots that
other groups recorded, and its predictions are compared with those of a regression without mechanics. The
recordings are not part of the project.

The linear regression ("line") has one coefficient for the effect of each pressure on each angle, cross-talk
between the segments included. The model of a calibration has no parameter for this cross-talk and none for
the memory of rubber, which may be why the regression predicts some angles better. A diagnosis allows for a
usual share of both, and errs less than the regression in every angle of the whole recording.
"""


@click.command()
@json_option
@quick_option
@click.option("--write", type=PATH, help="Write the tables to a page.")
def command(as_json: bool, quick: bool, write: Path | None) -> None:
    """Calibrate on real recordings and predict what was held out: two arms and a silicone beam.

    The benchmark reads the development recordings beside the checkout, or those that SOFTARM_RECORDINGS
    names.

    Example: softarm bench real-data --json
    """
    folder = recordings_folder()
    with progress("the beam") as advance:
        beam = beam_tables(folder, advance)
    with progress("the arm") as advance:
        arm = arm_tables(folder, 60 if quick else 300, advance)
    with progress("the segment") as advance:
        segment = segment_tables(folder, advance)
    with progress("diagnoses") as advance:
        diagnoses = (*arm_diagnoses(folder, advance), diagnosed_valves(folder), diagnosed_beam(folder))
    tables = (*arm, *segment, *beam, *diagnoses)
    show(*tables, as_json=as_json)
    if write is not None:
        write.write_text(f"{PAGE}\n{as_markdown(*tables)}\n", encoding="utf-8")
        notify(f"wrote {write}")


def recordings_folder() -> Path:
    """Find the development recordings.

    Raises:
        InputError: They are not there.
    """
    folder = Path(os.environ.get("SOFTARM_RECORDINGS", BESIDE))
    if not (folder / ARM).is_dir():
        raise InputError(
            str(folder), f"holds no {ARM}", "set SOFTARM_RECORDINGS to the folder of the recordings"
        )
    return folder


def described(name: str) -> Specimen:
    """Return a shipped specimen without what any recording has told of it."""
    return load_specimen(name).model_copy(update={"calibration": Calibration()})


def named_model(specimen: Specimen, advance: Callable[[float], None]) -> tuple[BatchArmModel, str]:
    """Return what a calibration runs on, and its name."""
    model = quick_model(specimen, advance)
    return model, "finite elements" if isinstance(model, SequentialBatchModel) else "the calibrated rod"


@dataclass(frozen=True)
class ArmErrors:
    """Errors [rad] of a model and of a line on blocks, by component of each bend.

    Args:
        names: Components.
        line_training: Of the line on the blocks that it was fitted on.
        line: Of the line on the others.
        training: Of the model on the blocks that it was fitted on.
        model: Of the model on the others.
    """

    names: tuple[str, ...]
    line_training: Floats
    line: Floats
    training: Floats
    model: Floats


def arm_tables(folder: Path, nodes: int, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Calibrate the SoPrA arm on alternate blocks of ten seconds, predict the others, and the other way."""
    specimen = described("sopra")
    (recording,) = load_recordings([folder / ARM])
    mesh = SequentialBatchModel(build_arm(specimen, loads=()), advance)
    solver, solved_by = named_model(specimen, advance)
    run = arrange(recording, specimen, solver.sections)
    even = training_blocks(block_of(run, run.time))
    folds, founds, checks = [], [], []
    for train in (even, ~even):
        found = calibrate(solver, specimen, [run.window(train)], Options(nodes=nodes))
        founds.append(found)
        known = calibrated_specimen(specimen, found)
        folds.append(arm_errors(solver, recording, run, known, train, RATE))
        checks.append(arm_errors(mesh, recording, run, known, train, CHECK_RATE).model)
    errors = joined(folds)
    checked = float(np.degrees(np.sqrt(np.mean(np.square(checks)))))
    rows: list[dict[str, Cell]] = []
    for index, name in enumerate(errors.names):
        rows.append(_error_row(name, *(part[index] for part in _parts(errors))))
    rows.append(_error_row("all", *(float(np.sqrt((part**2).mean())) for part in _parts(errors))))
    return (
        Table(
            f"{ARM}: rms error of the bends [degrees]",
            rows,
            (
                "Cross-validated: fitted on the even blocks of ten seconds and judged on the odd ones, then "
                f"the other way, at {RATE:g} samples per second.",
                f"Line: ordinary linear regression of six pressures (and an offset) to four angles, "
                f"{7 * len(errors.names)} numbers. Model: {founds[0].fitted} and {founds[1].fitted} numbers, "
                f"fitted and judged on {solved_by}.",
                f"The finite elements with the same numbers leave {checked:.3g} degrees of all held-out "
                f"angles, at {CHECK_RATE:g} samples per second.",
            ),
        ),
        Table(f"{ARM}: what the model was fitted with", unknown_rows(founds)),
    )


def unknown_rows(founds: Sequence[Calibrated]) -> list[dict[str, Cell]]:
    """Put what the folds found side by side: what is physical should be the same in both."""
    rows: list[dict[str, Cell]] = []
    for entry in founds[0].identified:
        name = entry.unknown.name
        row: dict[str, Cell] = {"unknown": name}
        for number, found in enumerate(founds):
            value = found.value(name)
            row[f"value_{number}"] = None if value is None else value.value
            row[f"std_{number}"] = None if value is None else value.std
        unit = "factor" if isinstance(entry.unknown, Modulus) else entry.unknown.unit
        rows.append(row | {"unit": unit, "verdict_0": entry.verdict})
    return rows


def arm_errors(
    model: BatchArmModel,
    recording: Recording,
    run: CalibrationRun,
    calibrated: Specimen,
    train: Flags,
    rate: float,
) -> ArmErrors:
    """Compare a calibrated model and a line on training and on held-out samples.

    Args:
        model: Model of the arm.
        recording: What was recorded.
        run: The same, arranged.
        calibrated: The specimen, calibrated on the training samples.
        train: Training samples of the run, shape (samples,).
        rate: Of the samples that count [Hz].
    """
    line = fit_line(run.pressures[train], run.readings[train])
    slow = resample(arrange(recording, calibrated, model.sections), rate)
    even = training_blocks(block_of(run, slow.time))
    seen = even if train[0] == training_blocks(block_of(run, run.time))[0] else ~even
    left = slow.readings - predict(model, calibrated, slow)
    by_line = slow.readings - line.predict(slow.pressures)
    names = tuple(f"{m.name} {axis}" for m in run.suite.measurements for axis in "xy")
    return ArmErrors(names, _rms(by_line[seen]), _rms(by_line[~seen]), _rms(left[seen]), _rms(left[~seen]))


def joined(folds: Sequence[ArmErrors]) -> ArmErrors:
    """Return the root mean square over folds."""

    def mean(name: str) -> Floats:
        return np.asarray(np.sqrt(np.mean([getattr(fold, name) ** 2 for fold in folds], axis=0)))

    return ArmErrors(folds[0].names, *(mean(n) for n in ("line_training", "line", "training", "model")))


def segment_tables(folder: Path, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Predict each step of the single segment from a calibration on the others."""
    recordings = load_recordings([folder / f"{SEGMENT}_{size}" for size in STEPS])
    rows = segment_rows(recordings, advance)
    whole: dict[str, Cell] = {}
    for name in ("moved_mm", "line_mm", "cubic_mm", "model_mm"):
        sizes = [size for row in rows if isinstance(size := row[name], float)]
        whole[name] = float(np.sqrt(np.mean(np.square(sizes)))) if sizes else None
    return (
        Table(
            f"{SEGMENT}: tip at the end of each step, predicted from the other steps",
            [*rows, {"pressure_kpa": "rms", **whole}],
            (
                f"Leave one step out; no fit of the model begins after {SEGMENT_SECONDS:g} s.",
                "Root mean square over the three tip markers of measured minus predicted; moved: the same of "
                "measured minus rest.",
                "Line and cubic: polynomials of the nominal pressure for each of nine coordinates, 18 and 36 "
                "numbers. Pressures were not logged: they are nominal.",
                "Model: finite elements with the walls of the shipped specimen; their "
                "stiffness around the chambers was found on the four lowest steps.",
            ),
        ),
    )


def segment_rows(recordings: Sequence[Recording], advance: Callable[[float], None]) -> list[dict[str, Cell]]:
    """Leave out one step after the other, as far as the time goes."""
    specimen = described("single_segment")
    model = build_arm(specimen, ())
    bounded = replace(model.settings, total_iterations=LINEAR_SOLVES)
    solver = SequentialBatchModel(replace(model, settings=bounded), advance)
    ends = [cut(recording, settled(recording, SETTLED_STEP)) for recording in recordings]
    pressures = np.array([float(np.nanmean(end.pressure(0)[0])) for end in ends])
    runs = [arrange(end, specimen, solver.sections) for end in ends]
    readings = np.array([np.nanmean(run.readings, axis=0) for run in runs])
    rests = [arrange(cut(r, (0.0, float(r.info["onset_s"]))), specimen, solver.sections) for r in recordings]
    travel = [np.nanmean(rest.readings, axis=0) - end for rest, end in zip(rests, readings, strict=True)]
    rows: list[dict[str, Cell]] = []
    options = Options(nodes=len(runs), iterations=6, fit_lag=False)
    deadline = time.monotonic() + SEGMENT_SECONDS
    for index, pressure in enumerate(pressures):
        others = np.arange(len(runs)) != index
        row: dict[str, Cell] = {"pressure_kpa": pressure / 1e3, "moved_mm": _length(travel[index])}
        for name, degree in (("line_mm", 1), ("cubic_mm", 3)):
            fitted = np.polyfit(pressures[others], readings[others], degree)
            powers = pressure ** np.arange(degree, -1, -1)
            row[name] = _length(powers @ fitted - readings[index])
        row |= {"model_mm": None, "model_numbers": None, "why_not": "no time left"}
        if time.monotonic() < deadline:
            chosen = [run for run, in_ in zip(runs, others, strict=True) if in_]
            try:
                found = calibrate(solver, specimen, chosen, options)
            except CalibrationRefusedError as refusal:
                row["why_not"] = refusal.what
            else:
                known = calibrated_specimen(specimen, found)
                left = np.nanmean(predict(solver, known, runs[index]), axis=0) - readings[index]
                row |= {"model_mm": _length(left), "model_numbers": found.fitted, "why_not": ""}
        rows.append(row)
    return rows


def _length(offsets: Floats) -> float:
    """Return the root mean square distance of markers [mm] from their offsets [m], three per marker."""
    return float(1e3 * np.sqrt((offsets.reshape(-1, 3) ** 2).sum(axis=1).mean()))


def predict(model: BatchArmModel, calibrated: Specimen, run: CalibrationRun) -> Floats:
    """Return the readings of a run that a calibrated specimen predicts, shape (samples, readings)."""
    gain = calibrated.calibration.stretch_gain.value
    setting = Setting.of(calibrated, StretchLaw.of(calibrated, model.sections) if gain else None)
    acting = setting.actuation.to_chamber(run.pressures)
    loads = np.zeros((len(acting), len(model.loads)))
    found = setting.model(model).evaluate(BatchInputs(acting, loads, np.array(calibrated.gravity_m_s2)))
    readings = run.suite.predict(found.frames)
    return np.where(found.converged[:, None], readings, np.nan)


def beam_tables(folder: Path, advance: Callable[[float], None]) -> tuple[Table, ...]:
    """Find the bare beam's modulus from its sag and predict the loaded beam with it."""
    specimen = described("beam")
    (bare,) = load_recordings([folder / BARE])
    model = build_arm(specimen)
    options = Options(fit_lag=False)
    runs = [arrange(cut(bare, settled(bare)), specimen, model.sections)]
    found = calibrate(SequentialBatchModel(model.with_loads(()), advance), specimen, runs, options)
    calibrated = calibrated_specimen(specimen, found)
    scale = calibrated.calibration.modulus_scale["upper"]
    young = specimen.materials[specimen.segments[0].material].young
    rows = [_beam_row(folder / name, calibrated, advance) for name in (BARE, LOADED)]
    bare_force = _number(rows[0], "force_settled_n")
    rows = [{**row, "weight_estimated_n": bare_force - _number(row, "force_settled_n")} for row in rows]
    return (
        Table(
            "Silicone beam: calibrated on the settled bare beam",
            [
                {
                    "young_kpa": young * scale.value / 1e3,
                    "std_kpa": young * scale.std / 1e3,
                    "owners_kpa": 264.0,
                }
            ],
        ),
        Table(
            "Silicone beam: from held level to settled",
            rows,
            (
                "Drop of the tip: by its markers, and by the model with the weight known to hang there.",
                "Forces at the tip along x (up): estimated from the motion alone.",
                "Weight: the force on the settled bare beam less that on this one.",
            ),
        ),
    )


def settled(recording: Recording, duration: float = 1.0) -> tuple[float, float]:
    """Return the window at the end in which the swing has died away [s]."""
    end = float(recording.time[-1])
    return end - duration, end


def _beam_row(folder: Path, calibrated: Specimen, advance: Callable[[float], None]) -> dict[str, Cell]:
    (recording,) = load_recordings([folder])
    truth = weight(folder)
    model = build_arm(calibrated)
    tip = model.sections.index("tip")
    ends = []
    for window in (HELD, settled(recording)):
        run = resample(arrange(cut(recording, window), calibrated, model.sections), RATE)
        ends.append(track(model, calibrated, run, advance))
    held, rest = (np.nanmean(end.frames.positions[:, tip, 0]) for end in ends)
    forces = [float(np.nanmean(end.forces[:, 0])) for end in ends]
    gravity = np.array(calibrated.gravity_m_s2)
    level = float(np.nanmean(ends[0].forces[:, 0]))
    drops = []
    for force in (level, -truth):
        state, _ = model.solve(Inputs(np.zeros(0), np.array([force, 0.0]), gravity), model.rest())
        drops.append(model.section_frames(state).positions[tip, 0])
    return {
        "recording": recording.name,
        "drop_measured_mm": (held - rest) * 1e3,
        "drop_predicted_mm": (drops[0] - drops[1]) * 1e3,
        "force_held_n": forces[0],
        "force_settled_n": forces[1],
        "weight_known_n": truth,
        "std_of_force_n": float(np.nanmedian(ends[1].force_std[:, 0])),
    }


def _number(row: dict[str, Cell], heading: str) -> float:
    value = row[heading]
    assert isinstance(value, float)
    return value


def _parts(errors: ArmErrors) -> tuple[Floats, Floats, Floats, Floats]:
    return errors.line_training, errors.line, errors.training, errors.model


def _error_row(
    name: str, line_training: float, line: float, training: float, model: float
) -> dict[str, Cell]:
    return {
        "angle": name,
        "line_on_its_blocks": float(np.degrees(line_training)),
        "line_held_out": float(np.degrees(line)),
        "model_on_its_blocks": float(np.degrees(training)),
        "model_held_out": float(np.degrees(model)),
    }


def _rms(left: Floats) -> Floats:
    """Return the root mean square of each column, lost samples left out."""
    values: Floats = np.sqrt(np.nanmean(left**2, axis=0))
    return values
